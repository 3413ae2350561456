#include "core/field/skeleton_field.h"
#include "core/field/blend_graph.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <optional>

#include "embedded/skeleton_field.cl.h"
#include "kernels/device_field.h"

namespace isoskin::opencl {
namespace {

constexpr std::size_t kLoopAll = 8;      // so few compact elements cost less than finding their cell
constexpr int kMostCells = 64;           // along an axis of the grid of lists
constexpr double kCellsPerReach = 2.0;   // cells along the mean radius
constexpr double kRoundingSlack = 1e-3;  // of a cell: a point may be put in the next cell by rounding

struct SkeletonElementData {  // SkeletonElement in skeleton_field.cl
  float a[3];
  float unused;
  float ab[3];
  float over_length2;
  float over_radius2;
  float scale[3];
  float norm;
  cl_int potential;
  cl_int solid;
  cl_int more_unused;
};
static_assert(sizeof(SkeletonElementData) == 64);

struct SkeletonSolidData {  // SkeletonSolid in skeleton_field.cl
  float ac[3];
  float over_ac2;
  float ad[3];
  float over_ad2;
  float to_b[3];
  float over_bc2;
  float to_c[3];
  cl_int is_box;
};
static_assert(sizeof(SkeletonSolidData) == sizeof(SkeletonElementData));

struct SkeletonParams {
  Origin origin;
  float iso;
  float low[3];
  float over_cell;
  cl_int size[3];
  cl_uint always;
};
static_assert(sizeof(SkeletonParams) == 60);

/// Euclidean distance within which a compact element may be felt.
double reach(const SkeletonElement& e) {
  return e.radius * std::max(1.0, std::pow(3.0, 0.5 - 1.0 / e.norm));
}

/// Factors that profile() in skeleton_field.cl leaves out of the value, twice the first and four times the second
/// derivative by d^2.
DVec3 profile_scale(const SkeletonElement& e) {
  const double by_r2 = 1.0 / (e.radius * e.radius);
  switch (e.potential) {
    case Potential::inverse_square:
      return {1.0, -2.0, 8.0};
    case Potential::cauchy:
      return e.radius * DVec3(1.0, -2.0, 8.0);
    case Potential::metaball:
      return {1.0, -6.0 * by_r2, 24.0 * by_r2 * by_r2};
    case Potential::blinn:
      return {1.0, -2.0 * by_r2, 4.0 * by_r2 * by_r2};
    case Potential::wyvill:
      return {1.0, 2.0 / 9.0 * by_r2, 4.0 / 9.0 * by_r2 * by_r2};
  }
  return DVec3(0.0);
}

void set(float (&to)[3], const DVec3& v) {
  for (int i = 0; i < 3; ++i) to[i] = static_cast<float>(v[i]);
}

/// 1 / |v|^2, or 0 where that is no float.
float over_square(const DVec3& v) {
  const float over = static_cast<float>(1.0 / glm::dot(v, v));
  return std::isfinite(over) ? over : 0.0f;
}

SkeletonElementData pack(const SkeletonElement& e, const DVec3& origin) {
  SkeletonElementData data{};
  set(data.a, e.a - origin);
  set(data.ab, e.b - e.a);
  data.over_length2 = over_square(e.b - e.a);
  data.over_radius2 = static_cast<float>(1.0 / (e.radius * e.radius));
  const DVec3 scale = e.weight * profile_scale(e);
  for (int i = 0; i < 3; ++i) data.scale[i] = static_cast<float>(scale[i]);
  data.norm = static_cast<float>(e.norm);
  data.potential = static_cast<cl_int>(e.potential);
  return data;
}

SkeletonElementData pack_solid(const SkeletonElement& e) {
  const DVec3 ab = e.b - e.a, ac = e.c - e.a;
  SkeletonSolidData data{};
  set(data.ac, ac);
  data.over_ac2 = over_square(ac);
  data.is_box = e.shape == Shape::box;
  if (data.is_box) {
    set(data.ad, e.d - e.a);
    data.over_ad2 = over_square(e.d - e.a);
  } else {
    const DVec3 normal = glm::cross(ab, ac);
    const double square = glm::dot(normal, normal);
    data.over_bc2 = over_square(ac - ab);
    if (std::isfinite(1.0 / square)) {
      set(data.ad, normal / std::sqrt(square));
      set(data.to_b, glm::cross(ac, normal) / square);
      set(data.to_c, glm::cross(normal, ab) / square);
    }
  }
  return std::bit_cast<SkeletonElementData>(data);
}

/// Elements in the order the kernel adds them: those that reach every point first, then by kind, so that the branch on
/// the kind is foreseeable.
std::vector<SkeletonElement> in_order(std::vector<SkeletonElement> elements) {
  const auto key = [](const SkeletonElement& e) {
    return std::tuple(is_compact(e), e.potential, e.shape, e.a != e.b, e.norm != 2.0);
  };
  std::stable_sort(elements.begin(), elements.end(),
                   [&](const SkeletonElement& a, const SkeletonElement& b) { return key(a) < key(b); });
  return elements;
}

struct CellGrid {
  DVec3 low{0.0};
  double cell = 1.0;
  IVec3 size{0};
  std::vector<cl_uint> first{0};  // one a cell and one more: where its list begins
  std::vector<cl_uint> list;
};

/// The cells that one element is listed in.
struct Listed {
  std::optional<SkeletonElement> element;
  std::vector<std::size_t> cells;
};

/// `before`, the last grid, and `listed`, one an element of its, tell in which cells elements are that have stayed.
CellGrid cell_grid(const std::vector<SkeletonElement>& elements, std::size_t compact_first, const CellGrid& before,
                   std::vector<Listed>& listed) {
  CellGrid grid;
  grid.list.resize(compact_first);
  std::iota(grid.list.begin(), grid.list.end(), 0u);
  if (compact_first == elements.size()) return grid;

  Box box;
  double sum = 0.0;
  for (std::size_t i = compact_first; i < elements.size(); ++i) {
    const double r = reach(elements[i]);
    box.add(extent(elements[i]).grown(r));
    sum += r;
  }
  const DVec3 room = box.size();
  // Rounded, so that cells seldom change when elements move.
  constexpr double kCellsAnOctave = 4.0;
  const double wanted = sum / static_cast<double>(elements.size() - compact_first) / kCellsPerReach;
  const double least = std::max(wanted, std::max({room.x, room.y, room.z}) / kMostCells);
  grid.cell = std::exp2(std::ceil(kCellsAnOctave * std::log2(least)) / kCellsAnOctave);
  grid.low = grid.cell * glm::floor(box.low / grid.cell);
  for (int i = 0; i < 3; ++i)
    grid.size[i] = std::clamp(static_cast<int>(std::ceil((box.high[i] - grid.low[i]) / grid.cell)), 1, kMostCells + 1);
  if (grid.low != before.low || grid.cell != before.cell || grid.size != before.size) listed.clear();
  listed.resize(elements.size());

  const auto list = [&](std::size_t i) {
    const SkeletonElement& e = elements[i];
    if (listed[i].element == e) return;
    listed[i] = {e, {}};
    const double near = reach(e) + grid.cell * (0.5 * std::sqrt(3.0) + kRoundingSlack);
    const auto cell_of = [&](const DVec3& p) {
      return glm::clamp(IVec3(glm::floor((p - grid.low) / grid.cell)), IVec3(0), grid.size - 1);
    };
    const Box felt = extent(e).grown(reach(e) + kRoundingSlack * grid.cell);
    const IVec3 from = cell_of(felt.low), to = cell_of(felt.high);
    for (int x = from.x; x <= to.x; ++x)
      for (int y = from.y; y <= to.y; ++y)
        for (int z = from.z; z <= to.z; ++z)
          if (glm::length(offset_from(e, grid.low + grid.cell * (DVec3(x, y, z) + 0.5)).x) <= near)
            listed[i].cells.push_back((static_cast<std::size_t>(x) * grid.size.y + y) * grid.size.z + z);
  };
  const std::size_t cells = static_cast<std::size_t>(grid.size.x) * grid.size.y * grid.size.z;
  grid.first.assign(cells + 1, 0);
  for (std::size_t i = compact_first; i < elements.size(); ++i) {
    list(i);
    for (const std::size_t c : listed[i].cells) ++grid.first[c + 1];
  }
  grid.first[0] = static_cast<cl_uint>(compact_first);
  std::partial_sum(grid.first.begin(), grid.first.end(), grid.first.begin());
  grid.list.resize(grid.first.back());
  std::vector<cl_uint> at(grid.first.begin(), grid.first.end() - 1);
  for (std::size_t i = compact_first; i < elements.size(); ++i)
    for (const std::size_t c : listed[i].cells) grid.list[at[c]++] = static_cast<cl_uint>(i);
  return grid;
}

class SkeletonDeviceField final : public DeviceField {
public:
  explicit SkeletonDeviceField(Device& device)
      : width_(device.vector_width()), elements_(device), first_(device), list_(device) {}

  bool takes(const Field& field) const override {
    return dynamic_cast<const SkeletonField*>(&field) || dynamic_cast<const BlendGraphField*>(&field);
  }

  void upload(const Field& field) override {
    const auto* blend = dynamic_cast<const BlendGraphField*>(&field);
    groups_ = blend != nullptr;
    if (blend) {
      upload_groups(*blend);
    } else {
      upload_skeleton(static_cast<const SkeletonField&>(field));
    }
  }

  const char* source() const override { return source::skeleton_field; }
  std::string build_options() const override {
    return "-DVW=" + std::to_string(width_) + (general_norm_ ? " -DGENERAL_NORM" : "") + (solids_ ? " -DSOLIDS" : "") +
           (groups_ ? " -DGROUPS" : "");
  }
  int width() const override { return width_; }
  const Origin& origin() const override { return params_.origin; }
  void bind(Device& device, const Kernel& kernel, cl_uint& slot) const override {
    device.set_argument(kernel, slot, elements_);
    device.set_argument(kernel, slot, first_);
    device.set_argument(kernel, slot, list_);
    device.set_argument(kernel, slot, params_);
  }

private:
  /// The elements of all groups, one group after the other; first_ tells where each begins.
  void upload_groups(const BlendGraphField& field) {
    std::vector<SkeletonElement> elements;
    CellGrid grid;  // without cells
    grid.first = {0};
    for (const SkeletonField& group : field.groups()) {
      const std::vector<SkeletonElement> members = in_order(group.elements());
      elements.insert(elements.end(), members.begin(), members.end());
      grid.first.push_back(static_cast<cl_uint>(elements.size()));
    }
    grid.list.resize(elements.size());
    std::iota(grid.list.begin(), grid.list.end(), 0u);
    assign(elements, grid, field.groups().size(), field.groups().front().iso(), middle_of(elements));
  }

  void upload_skeleton(const SkeletonField& field) {
    const std::vector<SkeletonElement> elements = in_order(field.elements());
    std::size_t compact_first = std::find_if(elements.begin(), elements.end(), is_compact) - elements.begin();
    if (elements.size() - compact_first <= kLoopAll) compact_first = elements.size();
    grid_ = cell_grid(elements, compact_first, grid_, listed_);
    assign(elements, grid_, compact_first, field.iso(), field.origin());
  }

  static DVec3 middle_of(const std::vector<SkeletonElement>& elements) {
    Box box;
    for (const SkeletonElement& e : elements) box.add(extent(e));
    return box.empty() ? DVec3(0.0) : box.center();
  }

  void assign(const std::vector<SkeletonElement>& elements, const CellGrid& grid, std::size_t always, double iso,
              const DVec3& origin) {
    std::vector<SkeletonElementData> data;
    for (const SkeletonElement& e : elements) data.push_back(pack(e, origin));
    for (std::size_t i = 0; i < elements.size(); ++i) {
      if (elements[i].shape == Shape::segment) continue;
      data[i].solid = static_cast<cl_int>(data.size());
      data.push_back(pack_solid(elements[i]));
    }
    solids_ = data.size() > elements.size();
    elements_.send(data);
    first_.send(grid.first);
    list_.assign(grid.list);
    params_.origin = make_origin(origin);
    params_.iso = static_cast<float>(iso);
    for (int i = 0; i < 3; ++i) params_.low[i] = static_cast<float>(grid.low[i] - origin[i]);
    for (int i = 0; i < 3; ++i) params_.size[i] = grid.size[i];
    params_.over_cell = static_cast<float>(1.0 / grid.cell);
    params_.always = static_cast<cl_uint>(always);
    general_norm_ = std::any_of(elements.begin(), elements.end(), [](const auto& e) { return e.norm != 2.0; });
  }

  int width_;
  CellGrid grid_;  // of the last skeleton that was no blend graph
  std::vector<Listed> listed_;
  Array<SkeletonElementData> elements_;
  Array<cl_uint> first_, list_;
  SkeletonParams params_{};
  bool general_norm_ = false, solids_ = false, groups_ = false;
};

}  // namespace

std::unique_ptr<DeviceField> make_skeleton_device_field(Device& device) {
  return std::make_unique<SkeletonDeviceField>(device);
}

}  // namespace isoskin::opencl

#include "core/io/sequence.h"

#include <fmt/format.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/LevelSetFilter.h>
#include <openvdb/tools/ValueTransformer.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "core/field/brick_builder.h"
#include "core/io/frame_files.h"
#include "core/io/prefetch.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;
using openvdb::Coord;
using openvdb::FloatGrid;
using FloatLeaf = openvdb::FloatTree::LeafNodeType;

constexpr int kBrick = BrickGrid::kBrick;
constexpr double kDefaultFrameDuration = 1.0 / 24.0;
constexpr float kDefaultFogIso = 0.5f;
constexpr double kMostBlocks = 64.0 * 1024 * 1024;  // of the index table, 4 bytes each

IVec3 to_ivec(const Coord& c) {
  return {c.x(), c.y(), c.z()};
}
Coord to_coord(const IVec3& c) {
  return {c.x, c.y, c.z};
}

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

// Runs `read` on the opened file; whatever OpenVDB throws becomes an InputError.
template <typename Read>
auto with_file(const fs::path& path, const Read& read) {
  static std::once_flag once;
  std::call_once(once, [] { openvdb::initialize(); });
  if (!fs::exists(path)) throw InputError(fmt::format("{}: no such file", path.string()));
  if (fs::is_directory(path)) throw InputError(fmt::format("{}: is a folder, expected an OpenVDB file", path.string()));
  try {
    openvdb::io::File file(path.string());
    file.open(/*delayLoad=*/false);
    return read(file);
  } catch (const InputError&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(fmt::format("{}: not a whole OpenVDB file: {}", path.string(), one_line(error.what())));
  }
}

bool is_scalar(const openvdb::GridBase& grid) {
  return grid.valueType() == "float" || grid.valueType() == "double";
}

std::string names_of(const openvdb::GridPtrVec& grids) {
  std::string names;
  for (const auto& grid : grids)
    names += fmt::format("{}{} ({})", names.empty() ? "" : ", ", grid->getName(), grid->valueType());
  return names.empty() ? "none" : names;
}

// The metadata of the grid that the options ask for.
openvdb::GridBase::ConstPtr find_scalar(openvdb::io::File& file, const std::string& name) {
  const openvdb::GridPtrVecPtr grids = file.readAllGridMetadata();
  for (const auto& grid : *grids) {
    if (name.empty() ? is_scalar(*grid) : grid->getName() == name) {
      if (is_scalar(*grid)) return grid;
      throw InputError(fmt::format("{}: grid {} holds {}, expected float or double values", file.filename(), name,
                                   grid->valueType()));
    }
  }
  throw InputError(name.empty() ? fmt::format("{}: no scalar grid; present: {}", file.filename(), names_of(*grids))
                                : fmt::format("{}: no grid {}; present: {}", file.filename(), name, names_of(*grids)));
}

struct Placement {
  DVec3 origin{0.0};
  double h = 0.0;
};

Placement placement_of(const openvdb::GridBase& grid, const std::string& where) {
  const openvdb::math::Transform& transform = grid.transform();
  if (!transform.isLinear())
    throw InputError(where + "transform is not linear, expected uniform scale and translation");
  const openvdb::math::Mat4d m = transform.baseMap()->getAffineMap()->getMat4();  // row vectors: p * m
  constexpr double kRelative = 1e-6;
  const double h = m(0, 0);
  if (!(h > 0.0) || !std::isfinite(h)) {
    throw InputError(
        fmt::format("{}voxel size is {}, expected a positive number (no mirroring, no rotation)", where, h));
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      if (std::abs(m(i, j) - (i == j ? h : 0.0)) <= kRelative * h) continue;
      const openvdb::Vec3d size = transform.voxelSize();
      throw InputError(
          fmt::format("{}voxels are not axis-aligned cubes (voxel size {} {} {}, or rotated), expected "
                      "uniform scale and translation",
                      where, size.x(), size.y(), size.z()));
    }
    if (!std::isfinite(m(3, i))) throw InputError(where + "translation is not finite");
  }
  return {DVec3(m(3, 0), m(3, 1), m(3, 2)), h};
}

template <typename Leaf>
[[noreturn]] void fail_not_finite(const Leaf& leaf, const openvdb::GridBase& grid, const std::string& where) {
  const auto* data = leaf.buffer().data();
  const auto finite = [](const auto& value) { return openvdb::math::isFinite(value); };
  const auto offset = static_cast<openvdb::Index>(std::find_if_not(data, data + Leaf::SIZE, finite) - data);
  const Coord at = leaf.offsetToGlobalCoord(offset);
  const openvdb::Vec3d world = grid.indexToWorld(at);
  throw InputError(fmt::format("{}value is not finite at voxel ({}, {}, {}), world ({:.6g}, {:.6g}, {:.6g})", where,
                               at.x(), at.y(), at.z(), world.x(), world.y(), world.z()));
}

// The grid as floats. Of a double grid the iso value is taken off before rounding; then `iso` becomes 0.
FloatGrid::Ptr as_float(const openvdb::GridBase::Ptr& base, double& iso, const std::string& where) {
  if (const auto grid = openvdb::gridPtrCast<FloatGrid>(base)) return grid;
  const auto grid = openvdb::gridPtrCast<openvdb::DoubleGrid>(base);
  if (!grid) throw InputError(fmt::format("{}tree is a {}, expected OpenVDB's standard one", where, base->type()));
  openvdb::tools::foreach (grid->beginValueAll(),
                           [iso](const openvdb::DoubleGrid::ValueAllIter& at) { at.setValue(*at - iso); });
  grid->tree().root().setBackground(grid->background() - iso, /*updateChildNodes=*/false);
  iso = 0.0;
  auto tree = std::make_shared<openvdb::FloatTree>(grid->constTree());
  auto copy = FloatGrid::create(tree);
  copy->insertMeta(*grid);
  copy->setTransform(grid->transformPtr());
  return copy;
}

// Blocks from lowest to highest that hold a leaf or a tile other than background.
openvdb::CoordBBox occupied(const openvdb::FloatTree& tree, const std::vector<FloatLeaf*>& leaves) {
  openvdb::CoordBBox box;
  for (const FloatLeaf* leaf : leaves) box.expand(leaf->origin());
  auto tile = tree.cbeginValueAll();
  tile.setMaxDepth(openvdb::FloatTree::ValueAllCIter::LEAF_DEPTH - 1);
  for (; tile; ++tile) {
    if (*tile == tree.background()) continue;
    openvdb::CoordBBox own;
    tile.getBoundingBox(own);
    box.expand(own);
  }
  return {box.min() >> 3, box.max() >> 3};
}

// How values become F.
struct Sides {
  float sign = 1.0f, iso = 0.0f;  // F = sign * (value - iso)
  float least = 0.0f;             // nearer to zero F is moved to this distance, keeping its side

  float operator()(float value) const { return sign * (value - iso); }
  float off_zero(float f) const { return std::abs(f) < least ? (f > 0.0f ? least : -least) : f; }
};

// Turns every leaf's values into F; throws at the first that is not finite. Fills in sides.least: kOffZero times the
// voxel size for a level set, times the greatest |F| otherwise.
void make_field_values(const std::vector<FloatLeaf*>& leaves, const FloatGrid& grid, Sides& sides, double h,
                       const std::string& where) {
  struct Size {
    float least = 0.0f, most = 0.0f;
    bool finite = true;
  };
  std::vector<Size> sizes(leaves.size());
  const auto over_leaves = [&](const auto& body) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, leaves.size(), 64), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i) body(leaves[i]->buffer().data(), sizes[i]);
    });
  };
  over_leaves([&](float* f, Size& size) {
    size.least = std::abs(sides(f[0]));
    float poison = 0.0f;  // NaN as soon as one value is not finite
    for (openvdb::Index i = 0; i < FloatLeaf::SIZE; ++i) {
      poison += f[i] * 0.0f;
      const float value = std::abs(f[i] = sides(f[i]));
      size.least = value < size.least ? value : size.least;
      size.most = value > size.most ? value : size.most;
    }
    size.finite = poison == 0.0f;
  });
  float most = std::abs(sides(grid.background()));
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    if (!sizes[i].finite) fail_not_finite(*leaves[i], grid, where);
    most = std::max(most, sizes[i].most);
  }
  constexpr float kOffZero = 1e-6f;
  sides.least = kOffZero * (grid.getGridClass() == openvdb::GRID_LEVEL_SET ? static_cast<float>(h) : most);
  over_leaves([&](float* f, const Size& size) {
    if (size.least >= sides.least) return;
    for (openvdb::Index i = 0; i < FloatLeaf::SIZE; ++i) f[i] = sides.off_zero(f[i]);
  });
}

// Lays the tree out as a table. Leaves hold F already, tiles and background still hold the grid's values.
BlockValues blocks_of(const FloatGrid& grid, const std::vector<FloatLeaf*>& leaves, const Sides& sides,
                      const std::string& where) {
  const openvdb::CoordBBox box = occupied(grid.tree(), leaves);
  BlockValues blocks;
  blocks.low = to_ivec(box.min());
  const DVec3 size = DVec3(to_ivec(box.max())) - DVec3(blocks.low) + 1.0;
  if (size.x * size.y * size.z > kMostBlocks) {
    throw InputError(
        fmt::format("{}spreads over {:.0f} x {:.0f} x {:.0f} blocks of 8^3 voxels, expected at most {:.0f} in all",
                    where, size.x, size.y, size.z, kMostBlocks));
  }
  blocks.size = IVec3(size);
  const auto entries = static_cast<std::size_t>(size.x * size.y * size.z);
  blocks.values.resize(entries, nullptr);
  blocks.constant.resize(entries);
  const auto constant = [&](float value) {
    if (!std::isfinite(value)) throw InputError(where + "a tile or the background is not finite");
    return sides.off_zero(sides(value));
  };
  blocks.outside = constant(grid.background());
  tbb::parallel_for(0, blocks.size.x, [&](int x) {
    openvdb::tree::ValueAccessor<const openvdb::FloatTree, false> values(grid.tree());
    std::size_t entry = std::size_t(x) * blocks.size.y * blocks.size.z;
    for (int y = 0; y < blocks.size.y; ++y) {
      for (int z = 0; z < blocks.size.z; ++z, ++entry) {
        const Coord at = to_coord((blocks.low + IVec3(x, y, z)) * kBrick);
        if (const FloatLeaf* leaf = values.probeConstLeaf(at)) {
          blocks.values[entry] = leaf->buffer().data();
        } else {
          blocks.constant[entry] = constant(values.getValue(at));
        }
      }
    }
  });
  return blocks;
}

void smooth_level_set(FloatGrid& grid, int iterations, const std::string& where) {
  if (grid.getGridClass() != openvdb::GRID_LEVEL_SET)
    throw InputError(where + "not a level set, which smoothing expects");
  openvdb::tools::LevelSetFilter<FloatGrid> filter(grid);
  for (int i = 0; i < iterations; ++i) filter.meanCurvature();
}

std::shared_ptr<const GridField> make_field(const openvdb::GridBase::Ptr& base, const GridOptions& options,
                                            const std::string& where) {
  const Placement placement = placement_of(*base, where);
  const bool level_set = base->getGridClass() == openvdb::GRID_LEVEL_SET;
  double iso = level_set || options.iso_given ? options.iso : kDefaultFogIso;
  const FloatGrid::Ptr grid = as_float(base, iso, where);
  if (grid->activeVoxelCount() == 0) throw InputError(where + "is empty (no active voxel)");
  if (options.smooth > 0) smooth_level_set(*grid, options.smooth, where);
  std::vector<FloatLeaf*> leaves;
  grid->tree().getNodes(leaves);
  Sides sides{level_set ? -1.0f : 1.0f, static_cast<float>(iso)};
  make_field_values(leaves, *grid, sides, placement.h, where);
  const BlockValues blocks = blocks_of(*grid, leaves, sides, where);
  return std::make_shared<GridField>(
      std::make_shared<const BrickGrid>(build_bricks(blocks, placement.origin, placement.h, options.interpolation)));
}

template <typename Grid>
class VdbVelocity final : public VelocityField {
public:
  explicit VdbVelocity(typename Grid::ConstPtr grid)
      : grid_(std::move(grid)), staggered_(grid_->getGridClass() == openvdb::GRID_STAGGERED) {}

  DVec3 velocity(const DVec3& p) const override {
    // An accessor that the tree does not know costs nothing to make: one a call keeps calls apart.
    const openvdb::tree::ValueAccessor<const typename Grid::TreeType, false> values(grid_->tree());
    const openvdb::Vec3d at = grid_->worldToIndex(openvdb::Vec3d(p.x, p.y, p.z));
    const auto v = staggered_ ? openvdb::tools::StaggeredBoxSampler::sample(values, at)
                              : openvdb::tools::BoxSampler::sample(values, at);
    return {v.x(), v.y(), v.z()};
  }

private:
  typename Grid::ConstPtr grid_;
  bool staggered_;
};

template <typename Grid>
std::shared_ptr<const VelocityField> make_velocity(const openvdb::GridBase::Ptr& base, const std::string& where) {
  const auto grid = openvdb::gridPtrCast<Grid>(base);
  if (!grid) return nullptr;
  std::vector<const typename Grid::TreeType::LeafNodeType*> leaves;
  grid->tree().getNodes(leaves);
  for (const auto* leaf : leaves) {
    const auto* data = leaf->buffer().data();
    for (openvdb::Index i = 0; i < leaf->SIZE; ++i) {
      if (!openvdb::math::isFinite(data[i])) fail_not_finite(*leaf, *grid, where);
    }
  }
  return std::make_shared<VdbVelocity<Grid>>(grid);
}

std::shared_ptr<const VelocityField> read_velocity(openvdb::io::File& file, const std::string& name) {
  const openvdb::GridPtrVecPtr grids = file.readAllGridMetadata();
  const std::string where = fmt::format("{}: grid {}: ", file.filename(), name);
  if (std::none_of(grids->begin(), grids->end(), [&](const auto& grid) { return grid->getName() == name; })) {
    throw InputError(fmt::format("{}: no grid {}; present: {}", file.filename(), name, names_of(*grids)));
  }
  const openvdb::GridBase::Ptr base = file.readGrid(name);
  if (!base->transform().isLinear()) throw InputError(where + "transform is not linear");
  if (auto velocity = make_velocity<openvdb::Vec3SGrid>(base, where)) return velocity;
  if (auto velocity = make_velocity<openvdb::Vec3DGrid>(base, where)) return velocity;
  throw InputError(fmt::format("{}holds {} values, expected vectors of float or double", where, base->valueType()));
}

std::shared_ptr<const GridField> read_field(openvdb::io::File& file, const GridOptions& options) {
  const std::string name = find_scalar(file, options.grid)->getName();
  return make_field(file.readGrid(name), options, fmt::format("{}: grid {}: ", file.filename(), name));
}

// Seconds a frame by the file's own word, if it has one.
std::optional<double> stored_frame_duration(const fs::path& path, const std::string& grid) {
  return with_file(path, [&](openvdb::io::File& file) -> std::optional<double> {
    const openvdb::GridBase::ConstPtr found = find_scalar(file, grid);
    for (const char* key : {"frame_dt", "dt_seconds"}) {
      double dt = 0.0;
      if (const auto f = found->getMetadata<openvdb::FloatMetadata>(key)) dt = f->value();
      if (const auto d = found->getMetadata<openvdb::DoubleMetadata>(key)) dt = d->value();
      if (dt > 0.0 && std::isfinite(dt)) return dt;
    }
    return std::nullopt;
  });
}

FieldFrame load_frame(const fs::path& path, const GridOptions& options) {
  return with_file(path, [&](openvdb::io::File& file) {
    FieldFrame frame;
    frame.field = read_field(file, options);
    if (!options.velocity.empty()) frame.velocity = read_velocity(file, options.velocity);
    return frame;
  });
}

class SequenceSource final : public FieldSource {
public:
  SequenceSource(FrameFiles files, const SequenceOptions& options, int first, int last, double dt)
      : files_(std::move(files)),
        first_(first),
        last_(last),
        dt_(dt),
        prefetch_([this, grid = options.grid](int frame) { return load_one(frame, grid); }, last, options.ahead) {}

  int first_frame() const override { return first_; }
  int last_frame() const override { return last_; }
  double frame_duration() const override { return dt_; }
  std::string name() const override { return files_.name; }
  FieldFrame load(int frame) override {
    if (frame < first_ || frame > last_) {
      throw InputError(fmt::format("{}: no frame {}, expected {} to {}", files_.name, frame, first_, last_));
    }
    return prefetch_.get(frame);
  }

private:
  FieldFrame load_one(int frame, const GridOptions& grid) const {
    FieldFrame loaded = load_frame(files_.file.at(frame), grid);
    loaded.frame = frame;
    loaded.time = (frame - files_.file.begin()->first) * dt_;
    return loaded;
  }

  FrameFiles files_;
  int first_, last_;
  double dt_;
  Prefetch prefetch_;  // last: its thread uses the rest
};

void check_options(const std::string& input, const SequenceOptions& options) {
  const auto expect = [&](bool good, const char* what) {
    if (!good) throw InputError(fmt::format("{}: {}", input, what));
  };
  expect(std::isfinite(options.grid.iso), "iso must be finite");
  expect(options.grid.smooth >= 0, "smooth must not be negative");
  expect(options.ahead >= 0, "the number of frames to load ahead must not be negative");
  expect(!options.dt || (std::isfinite(*options.dt) && *options.dt > 0.0), "dt must be positive and finite");
}

}  // namespace

std::shared_ptr<const GridField> load_grid(const fs::path& file, const GridOptions& options) {
  return with_file(file, [&](openvdb::io::File& open) { return read_field(open, options); });
}

std::vector<GridInfo> grid_info(const fs::path& path) {
  return with_file(path, [&](openvdb::io::File& file) {
    std::vector<GridInfo> infos;
    const openvdb::GridPtrVecPtr grids = file.getGrids();
    for (const auto& grid : *grids) {
      const openvdb::CoordBBox box = grid->evalActiveVoxelBoundingBox();
      infos.push_back({grid->getName(), grid->valueType(), openvdb::GridBase::gridClassToString(grid->getGridClass()),
                       grid->voxelSize().x(), static_cast<std::size_t>(grid->activeVoxelCount()), to_ivec(box.min()),
                       to_ivec(box.max())});
    }
    return infos;
  });
}

std::unique_ptr<FieldSource> open_sequence(const std::string& input, const SequenceOptions& options) {
  check_options(input, options);
  FrameFiles files = find_frames(input, ".vdb");
  const int first = options.first.value_or(files.file.begin()->first);
  const int last = options.last.value_or(files.file.rbegin()->first);
  if (first > last || !files.file.contains(first) || !files.file.contains(last)) {
    throw InputError(fmt::format("{}: no frames {} to {}; present: {} to {}", input, first, last,
                                 files.file.begin()->first, files.file.rbegin()->first));
  }
  const auto begin = files.file.find(first);
  for (auto [at, frame] = std::pair(begin, first); frame <= last; ++at, ++frame) {
    if (at->first != frame) {
      throw InputError(fmt::format("{}: frame {} is missing, expected next to {}", input, frame,
                                   std::prev(at)->second.filename().string()));
    }
  }
  const double dt = options.dt
                        ? *options.dt
                        : stored_frame_duration(begin->second, options.grid.grid).value_or(kDefaultFrameDuration);
  return std::make_unique<SequenceSource>(std::move(files), options, first, last, dt);
}

}  // namespace isoskin

#include "core/field/grid_field.h"

#include <optional>

#include "embedded/grid_field.cl.h"
#include "kernels/device_field.h"

namespace isoskin::opencl {
namespace {

struct GridParams {  // GridParams in grid_field.cl
  Origin origin;
  float over_h;
  cl_int size[3];
  float outside;
};
static_assert(sizeof(GridParams) == 44);

class GridDeviceField final : public DeviceField {
public:
  explicit GridDeviceField(Device& device) : device_(device), table_(device), constant_(device) {}

  bool takes(const Field& field) const override { return dynamic_cast<const GridField*>(&field) != nullptr; }

  void upload(const Field& field) override {
    const std::shared_ptr<const BrickGrid>& grid = static_cast<const GridField&>(field).grid();
    if (grid == uploaded_) return;
    tap_.reset();
    uploaded_ = nullptr;
    table_.send(grid->table);
    constant_.send(grid->constant);
    tap_.emplace(device_, grid->tap.data(), grid->tap.size() * sizeof(float));
    device_.finish();
    params_.origin = make_origin(grid->origin + grid->h * double{BrickGrid::kBrick} * DVec3(grid->table_low));
    params_.over_h = static_cast<float>(1.0 / grid->h);
    for (int i = 0; i < 3; ++i) params_.size[i] = grid->table_size[i];
    params_.outside = grid->outside;
    cubic_ = grid->interpolation == Interpolation::cubic;
    uploaded_ = grid;
  }

  const char* source() const override { return source::grid_field; }
  std::string build_options() const override { return cubic_ ? "-DVW=1 -DCUBIC" : "-DVW=1"; }
  int width() const override { return 1; }
  const Origin& origin() const override { return params_.origin; }
  void bind(Device& device, const Kernel& kernel, cl_uint& slot) const override {
    device.set_argument(kernel, slot, table_);
    device.set_argument(kernel, slot, constant_);
    device.set_argument(kernel, slot, *tap_);
    device.set_argument(kernel, slot, params_);
  }

private:
  Device& device_;
  Array<std::int32_t> table_;
  Array<float> constant_;
  GridParams params_{};
  bool cubic_ = true;
  std::shared_ptr<const BrickGrid> uploaded_;  // kept: a CPU reads its taps where they are
  std::optional<Borrowed> tap_;                // of it
};

}  // namespace

std::unique_ptr<DeviceField> make_grid_device_field(Device& device) {
  return std::make_unique<GridDeviceField>(device);
}

}  // namespace isoskin::opencl

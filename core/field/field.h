// The scalar field F(p): positive inside, zero on the surface (design 1 and 9). A Field is one frozen moment of an
// animation, immutable and safe to read from any thread.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "core/types.h"

namespace isoskin {

/// Value and gradient of F at a point.
struct FieldSample {
  double value = 0.0;
  DVec3 gradient{0.0};
};

/// Float64 definition of a field. Backends that know the concrete type (SkeletonField, GridField) run it as a kernel;
/// these methods are what the kernel must compute.
class Field {
public:
  virtual ~Field() = default;

  /// F and grad F at `p` (world units). Finite everywhere: at a singular point (a skeleton of inverse-square potential)
  /// the value is clamped to a large finite number and the gradient is zero.
  virtual FieldSample sample(const DVec3& p) const = 0;

  /// F alone; override where it is cheaper.
  virtual double value(const DVec3& p) const { return sample(p).value; }

  /// F at origin + spacing * (i, j, k), 0 <= (i, j, k) < count, z fastest: the very numbers that value() gives.
  /// Override where neighbours can share work.
  virtual void values(const DVec3& origin, double spacing, const IVec3& count, std::span<double> out) const;

  /// Second derivatives at `p`. The default takes central differences of the gradient.
  virtual DMat3 hessian(const DVec3& p) const;

  /// A box that contains the whole surface F = 0 (empty when there is none).
  virtual Box bounds() const = 0;

  /// Bounds of F over `box`, never too narrow; used to skip space. May be as wide as (-inf, inf).
  virtual Interval range(const Box& box) const = 0;

  /// The length below which the field has no detail of its own: the voxel size h of a grid; 0 where there is none.
  virtual double resolution() const { return 0.0; }

  /// True when F has continuous second derivatives (critical points exist and can be classified).
  virtual bool is_c2() const { return true; }

  /// What it holds in memory, roughly; 0 where that is little.
  virtual std::size_t bytes() const { return 0; }

  /// |F| / |grad F|, the distance estimate of design 8, with the gradient's norm kept above `least_slope`.
  double distance_estimate(const DVec3& p, double least_slope = 1e-12) const;
};

/// Outward unit normal -grad F / |grad F|; zero where the gradient vanishes.
DVec3 outward_normal(const DVec3& gradient);

/// A velocity field, world units a second.
class VelocityField {
public:
  virtual ~VelocityField() = default;
  virtual DVec3 velocity(const DVec3& p) const = 0;
};

/// One frame of an animated field.
struct FieldFrame {
  int frame = 0;
  double time = 0.0;                              // seconds
  std::shared_ptr<const Field> field;             // never null
  std::shared_ptr<const VelocityField> velocity;  // null when the source has none
};

/// An animation: a scene of skeletons or a sequence of grids. Frames are asked for in increasing order; a source may
/// load ahead. Not thread safe.
class FieldSource {
public:
  virtual ~FieldSource() = default;
  virtual int first_frame() const = 0;
  virtual int last_frame() const = 0;
  virtual double frame_duration() const = 0;  // dt, seconds
  /// Throws InputError when the frame is missing or unreadable.
  virtual FieldFrame load(int frame) = 0;
  /// A short name for output files ("dam_break").
  virtual std::string name() const = 0;
};

}  // namespace isoskin

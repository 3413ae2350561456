// Seeds: points that each skeleton element sends to the surface along axes of its own (Desbrun, Tsingos and Gascuel
// 1995, sections 2, 3 and 5).
#pragma once

#include <string>
#include <vector>

#include "core/backend.h"
#include "core/field/skeleton_field.h"
#include "core/mesh/triangle_mesh.h"

namespace isoskin {

struct SeedOptions {
  double spacing = 0.1;  // of the grid on an element's inflated box, world units
  int most_steps = 12;   // outward or inward, each twice as long as the one before, to bracket the surface
  int root_rounds = 4;   // of regula falsi
};

struct SeedReport {
  std::size_t seeds = 0, valid = 0;
  std::size_t lost = 0;         // axes on which no surface was found
  std::size_t evaluations = 0;  // of the whole field
};

/// What a field is made of. Throws InputError, beginning with `name`, for a field that is not made of skeleton
/// elements.
struct SkeletonParts {
  const std::vector<SkeletonElement>* elements;
  double iso;
};
SkeletonParts skeleton_parts(const Field& field, const std::string& name = "seeds");

/// The seeds of all elements: points, segments, triangles and boxes. A seed is a distance on its axis, which starts on
/// the element and is fixed in its frame:
/// a rigid motion moves seeds without any evaluation. Elements that grow or shrink get new ones, so that density stays.
class Seeds {
public:
  explicit Seeds(const SeedOptions& options) : options_(options) {}

  /// Seeds of the elements as they are now: kept where an element has its old shape, else made anew; then validated and
  /// moved to the surface, beginning at the last distances. The backend's field must be the elements'. Deterministic.
  SeedReport move_to(const SkeletonParts& parts, Backend& backend);

  /// Valid: on the surface, where no other element contributes more than the seed's own.
  const std::vector<Vec3>& position() const { return position_; }
  const std::vector<std::uint8_t>& valid() const { return valid_; }
  const std::vector<Index>& element() const { return element_; }  // of each seed, ascending

  /// Valid seeds as discs (hexagons) in the tangent plane, of diameter 0.9 spacing.
  TriangleMesh scales(Backend& backend) const;
  /// The closed grid of each element over its seeds; an invalid one stands where on its axis another element begins to
  /// contribute more, so the grids enclose the volumes in which their elements are preponderant.
  TriangleMesh pieces() const;

  /// The box of each element's valid seeds, grown by the largest distance of neighbours in its grid; empty without.
  const std::vector<Box>& boxes() const { return boxes_; }

private:
  struct Axis {
    DVec3 start, direction;  // in the world, now
  };
  struct Grid {
    SkeletonElement shape;         // it was made for
    std::vector<DVec3> box_point;  // on the inflated box, in the element's frame
    std::vector<Index> triangle;
    double thickness = 0.0;
  };

  Grid make_grid(const SkeletonElement& element, double iso) const;
  void pose(const std::vector<SkeletonElement>& elements);
  void find_neighbours(const std::vector<SkeletonElement>& elements);
  void validate();
  SeedReport migrate(Backend& backend);
  void update_boxes();
  Vec3 at(std::size_t seed, double distance) const;

  SeedOptions options_;
  std::vector<SkeletonField> single_;           // each element alone, iso 0
  std::vector<std::vector<Index>> neighbours_;  // elements that may be felt where an element's seeds are
  std::vector<Grid> grid_;                      // one an element
  std::vector<Index> first_;                    // of each element's seeds; one more
  std::vector<Axis> axis_;
  std::vector<double> distance_;
  std::vector<Vec3> position_;
  std::vector<std::uint8_t> valid_;
  std::vector<Index> element_;
  std::vector<Box> boxes_;
};

/// Seeds of one object inside the other, and what finding them cost.
struct Penetration {
  std::vector<Index> of_first, of_second;  // valid seeds of each that lie inside the other, ascending
  std::size_t evaluations = 0;             // of either field
  std::size_t without_boxes = 0;           // what testing every valid seed would have taken
  bool any() const { return !of_first.empty() || !of_second.empty(); }
};

/// A seed is tested when its element's box meets a box of the other object's (and the whole boxes meet). With `all`
/// every penetrating seed is found, else those of the first element that has one. `first_backend` and `second_backend`
/// hold the fields.
Penetration find_penetration(const Seeds& first, Backend& first_backend, const Seeds& second, Backend& second_backend,
                             bool all);

}  // namespace isoskin

// Skeletons that blend only with their neighbours (design 9; Desbrun, Tsingos and Gascuel 1995, section 4; Guy and
// Wyvill 1995).
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "core/field/skeleton_field.h"

namespace isoskin {

/// A pair of elements, by index, that blend.
using BlendEdge = std::array<Index, 2>;

/// The largest groups of elements that all blend with each other: every one ascending, the list ascending. An element
/// without neighbours is a group alone. Throws InputError for an index that is no element, an element paired with
/// itself, or a graph of more than 4096 groups.
std::vector<std::vector<Index>> blend_groups(std::size_t elements, const std::vector<BlendEdge>& edges);

/// F(p) = max over groups of (sum of the group's contributions) - iso. Desbrun et al. take the maximum over the groups
/// of the preponderant element only; that is the same where the largest sum has it, and jumps elsewhere, which this
/// does not. C0: a crease where two groups tell the same.
class BlendGraphField final : public Field {
public:
  /// `groups` are lists of indices into `elements`. Throws InputError as SkeletonField does, and without groups.
  BlendGraphField(const std::vector<SkeletonElement>& elements, double iso,
                  const std::vector<std::vector<Index>>& groups);

  FieldSample sample(const DVec3& p) const override;
  double value(const DVec3& p) const override;
  /// Of the group that tells the value.
  DMat3 hessian(const DVec3& p) const override;
  Box bounds() const override;
  Interval range(const Box& box) const override;
  bool is_c2() const override { return false; }

  const std::vector<SkeletonField>& groups() const { return groups_; }
  const std::vector<SkeletonElement>& elements() const { return elements_; }

private:
  std::vector<SkeletonElement> elements_;
  std::vector<SkeletonField> groups_;
};

/// A SkeletonField where all elements blend with each other, else a BlendGraphField.
std::shared_ptr<const Field> blended(std::vector<SkeletonElement> elements, double iso,
                                     const std::vector<std::vector<Index>>& groups);

}  // namespace isoskin

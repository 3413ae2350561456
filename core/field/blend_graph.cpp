#include "core/field/blend_graph.h"

#include <algorithm>
#include <string>

namespace isoskin {
namespace {

constexpr std::size_t kMostGroups = 4096;

using Row = std::vector<std::uint8_t>;  // of the adjacency matrix

/// Bron and Kerbosch 1973: extends `group` by each of `candidates`; it is maximal when none is left, nor one that was
/// tried before (`tried`).
class GroupSearch {
public:
  explicit GroupSearch(const std::vector<Row>& adjacent) : adjacent_(adjacent) {}

  void extend(std::vector<Index> group, std::vector<Index> candidates, std::vector<Index> tried) {
    if (candidates.empty() && tried.empty()) {
      if (groups.size() == kMostGroups)
        throw InputError("blend: more than " + std::to_string(kMostGroups) + " groups of elements that all blend");
      groups.push_back(std::move(group));
      return;
    }
    if (candidates.empty()) return;
    const Row& pivot = adjacent_[best_pivot(candidates, tried)];
    const std::vector<Index> all = candidates;
    for (const Index v : all) {
      if (pivot[v]) continue;
      std::vector<Index> longer = group;
      longer.push_back(v);
      extend(std::move(longer), neighbours(candidates, v), neighbours(tried, v));
      candidates.erase(std::find(candidates.begin(), candidates.end(), v));
      tried.push_back(v);
    }
  }

  std::vector<std::vector<Index>> groups;

private:
  std::vector<Index> neighbours(const std::vector<Index>& of, Index v) const {
    std::vector<Index> out;
    std::copy_if(of.begin(), of.end(), std::back_inserter(out), [&](Index u) { return adjacent_[v][u] != 0; });
    return out;
  }
  Index best_pivot(const std::vector<Index>& candidates, const std::vector<Index>& tried) const {
    Index best = candidates.front();
    std::size_t most = 0;
    for (const std::vector<Index>* list : {&candidates, &tried})
      for (const Index v : *list)
        if (const std::size_t n = neighbours(candidates, v).size(); n > most) best = v, most = n;
    return best;
  }

  const std::vector<Row>& adjacent_;
};

}  // namespace

std::vector<std::vector<Index>> blend_groups(std::size_t elements, const std::vector<BlendEdge>& edges) {
  std::vector<Row> adjacent(elements, Row(elements, 0));
  for (const auto& [a, b] : edges) {
    if (a >= elements || b >= elements || a == b)
      throw InputError("blend: expected pairs of two different elements, of which there are " +
                       std::to_string(elements));
    adjacent[a][b] = adjacent[b][a] = 1;
  }
  std::vector<Index> all(elements);
  for (Index i = 0; i < elements; ++i) all[i] = i;
  GroupSearch search(adjacent);
  if (elements > 0) search.extend({}, std::move(all), {});
  for (std::vector<Index>& group : search.groups) std::sort(group.begin(), group.end());
  std::sort(search.groups.begin(), search.groups.end());
  return search.groups;
}

BlendGraphField::BlendGraphField(const std::vector<SkeletonElement>& elements, double iso,
                                 const std::vector<std::vector<Index>>& groups)
    : elements_(elements) {
  if (groups.empty()) throw InputError("skeleton: expected at least one group of elements");
  for (const std::vector<Index>& group : groups) {
    std::vector<SkeletonElement> members;
    for (const Index i : group) members.push_back(elements.at(i));
    groups_.emplace_back(std::move(members), iso);
  }
}

FieldSample BlendGraphField::sample(const DVec3& p) const {
  FieldSample best = groups_.front().sample(p);
  for (std::size_t g = 1; g < groups_.size(); ++g)
    if (const FieldSample s = groups_[g].sample(p); s.value > best.value) best = s;
  return best;
}

double BlendGraphField::value(const DVec3& p) const {
  double best = groups_.front().value(p);
  for (std::size_t g = 1; g < groups_.size(); ++g) best = std::max(best, groups_[g].value(p));
  return best;
}

DMat3 BlendGraphField::hessian(const DVec3& p) const {
  const auto of = std::max_element(groups_.begin(), groups_.end(), [&](const SkeletonField& a, const SkeletonField& b) {
    return a.value(p) < b.value(p);
  });
  return of->hessian(p);
}

Box BlendGraphField::bounds() const {
  Box box;
  for (const SkeletonField& group : groups_)
    if (const Box own = group.bounds(); !own.empty()) box.add(own);
  return box;
}

Interval BlendGraphField::range(const Box& box) const {
  Interval most = groups_.front().range(box);
  for (const SkeletonField& group : groups_) {
    const Interval own = group.range(box);
    most = {std::max(most.low, own.low), std::max(most.high, own.high)};
  }
  return most;
}

std::shared_ptr<const Field> blended(std::vector<SkeletonElement> elements, double iso,
                                     const std::vector<std::vector<Index>>& groups) {
  if (groups.size() == 1 && groups.front().size() == elements.size())
    return std::make_shared<SkeletonField>(std::move(elements), iso);
  return std::make_shared<BlendGraphField>(elements, iso, groups);
}

}  // namespace isoskin

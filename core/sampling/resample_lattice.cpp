#include <algorithm>
#include <cstring>
#include <iterator>
#include <utility>

#include "core/field/grid_field.h"
#include "core/parallel.h"
#include "core/sampling/ambiguous_faces.h"
#include "core/sampling/grid_lattice.h"
#include "core/sampling/hidden_crossings.h"
#include "core/sampling/sampling_steps.h"

namespace isoskin {
namespace {

constexpr std::size_t kValues = BrickLattice::kValues;
constexpr double kMostChanged = 0.5;  // of the bricks; where more have, telling them apart costs more than it saves

std::vector<Index> marked(const std::vector<std::uint8_t>& bricks) {
  std::vector<Index> out;
  for (std::size_t b = 0; b < bricks.size(); ++b)
    if (bricks[b]) out.push_back(Index(b));
  return out;
}

/// Moves every kept brick's values from where they were: source[b], or kNone for a brick that is new.
void move_values(std::vector<float>& value, const std::vector<Index>& source) {
  value.resize(std::max(value.size(), source.size() * kValues));
  const auto move_run = [&](std::size_t begin, std::size_t end) {
    std::memmove(&value[begin * kValues], &value[source[begin] * kValues], (end - begin) * kValues * sizeof(float));
  };
  // Runs that go together. Those that move down are moved first to last, then those that move up last to first, so that
  // none is overwritten before its turn.
  std::vector<std::pair<std::size_t, std::size_t>> up;
  for (std::size_t b = 0; b < source.size();) {
    std::size_t end = b + 1;
    while (source[b] != kNone && end < source.size() && source[end] == source[b] + Index(end - b)) ++end;
    if (source[b] != kNone && source[b] > b) move_run(b, end);
    if (source[b] != kNone && source[b] < b) up.emplace_back(b, end);
    b = end;
  }
  for (auto run = up.rbegin(); run != up.rend(); ++run) move_run(run->first, run->second);
  value.resize(source.size() * kValues);
}

/// A lattice on its way from one field to the next.
class Resampling {
public:
  Resampling(BrickLattice before, const FieldChanges& changes, const Field& field, Backend& backend)
      : field_(field),
        backend_(backend),
        mask_(changes, 0.0),
        lattice_(std::move(before)),
        parts_(grid() ? grid_parts(*grid()->grid(), lattice_.spacing) : 0) {}

  /// False where all has to be sampled anew, in the memory that finish() gives back.
  bool run(std::size_t max_bricks) {
    if (mask_.everywhere() || lattice_.extended) return false;
    const auto revealed_before = lattice_.revealed;
    hide_crossings(lattice_);
    if (!change_bricks(max_bricks) || !change_values()) return false;
    reveal_hidden_crossings(lattice_, signs_, field_, with_neighbours(lattice_, changed_));
    mark_newly_revealed(revealed_before);
    const std::vector<std::uint8_t> stale = with_neighbours(lattice_, changed_);
    set_signs(stale);
    resolve_ambiguous_faces(lattice_, signs_, field_, stale);
    resolve_tunnels(lattice_, signs_, field_, stale);
    for_each_index(stale.size(), [&](std::size_t b) {
      if (stale[b]) lattice_.same_as[b] = kNone;
    });
    return true;
  }

  BrickLattice finish() { return std::move(lattice_); }

private:
  /// Whether the field differs where the brick is sampled.
  bool touched(const IVec3& brick) const {
    const sampling::BrickRange range{lattice_.first_searched, lattice_.last_searched};
    return mask_.overlaps(parts_ > 0 ? lattice_.box(brick) : sampling::box_of_samples(lattice_, range, brick));
  }
  const GridField* grid() const { return dynamic_cast<const GridField*>(&field_); }

  /// The bricks of the new field: those that have not changed, and candidates among the others. Fills same_as.
  bool change_bricks(std::size_t max_bricks) {
    using sampling::before;
    std::vector<IVec3> candidates;
    if (parts_ > 0) {
      candidates = grid_candidates(*grid()->grid(), parts_, &mask_);
      if (double(candidates.size()) > kMostChanged * double(lattice_.brick_count())) return false;
    } else {
      const sampling::BrickRange range = sampling::bricks_in_bounds(field_, lattice_.origin, lattice_.spacing);
      if (range.first != lattice_.first_searched || range.last != lattice_.last_searched) return false;
      candidates = sampling::subdivide(field_, lattice_, range, max_bricks, &mask_);
    }
    std::vector<std::uint8_t> kept(lattice_.brick_count());
    for_each_heavy(kept.size(), [&](std::size_t b) { kept[b] = !touched(lattice_.coordinate[b]); });
    std::vector<IVec3> all;
    std::vector<Index> source;
    std::size_t next = 0;
    const auto add = [&](const IVec3& brick, Index from) {
      all.push_back(brick);
      source.push_back(from);
    };
    lattice_.gone.clear();
    for (std::size_t b = 0; b < kept.size(); ++b) {
      const IVec3& brick = lattice_.coordinate[b];
      for (; next < candidates.size() && before(candidates[next], brick); ++next) add(candidates[next], kNone);
      const bool again = next < candidates.size() && candidates[next] == brick;
      next += again;
      if (kept[b] || again)
        add(brick, Index(b));
      else
        lattice_.gone.push_back(brick);
    }
    for (; next < candidates.size(); ++next) add(candidates[next], kNone);
    sampling::check_count(all.size(), max_bricks, lattice_.spacing);
    if (all != lattice_.coordinate) {
      move_values(lattice_.value, source);
      lattice_.coordinate = std::move(all);
      lattice_.build_index();
    }
    lattice_.same_as = std::move(source);
    changed_.assign(lattice_.brick_count(), 0);
    for_each_heavy(changed_.size(), [&](std::size_t b) {
      changed_[b] = lattice_.same_as[b] == kNone || touched(lattice_.coordinate[b]);
    });
    for (const IVec3& brick : lattice_.gone)
      for (int i = 0; i < 27; ++i) {
        const Index b = lattice_.find(brick + IVec3(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1));
        if (b != kNone) changed_[b] = 1;
      }
    return true;
  }

  /// Samples what has changed; what shares corners with that may change in rounding.
  bool change_values() {
    const std::vector<Index> about = marked(with_neighbours(lattice_, changed_));
    std::vector<float> old(about.size() * kValues);
    for (std::size_t k = 0; k < about.size(); ++k)
      std::copy_n(&lattice_.value[about[k] * kValues], kValues, &old[k * kValues]);
    sampling::evaluate(lattice_, marked(changed_), field_, backend_);
    signs_.resize(lattice_.brick_count());
    if (parts_ > 0) sampling::unify_shared_corners(lattice_, about, signs_);
    for (std::size_t k = 0; k < about.size(); ++k)
      changed_[about[k]] |=
          std::memcmp(&old[k * kValues], &lattice_.value[about[k] * kValues], kValues * sizeof(float)) != 0;
    set_signs(with_neighbours(lattice_, with_neighbours(lattice_, changed_)));
    return sampling::missing_neighbours(lattice_, signs_, about).empty();
  }

  void set_signs(const std::vector<std::uint8_t>& bricks) {
    for_each_heavy(bricks.size(), [&](std::size_t b) {
      if (bricks[b]) signs_[b] = BrickSigns(&lattice_.value[b * kValues]);
    });
  }

  /// Bricks with corners that changed sides in one of the lattices and not, or otherwise, in the other.
  void mark_newly_revealed(const std::vector<BrickLattice::Revealed>& before) {
    const auto differs = [](const BrickLattice::Revealed& r, const std::vector<BrickLattice::Revealed>& among) {
      return std::find(among.begin(), among.end(), r) == among.end();
    };
    const auto mark = [&](const std::vector<BrickLattice::Revealed>& some,
                          const std::vector<BrickLattice::Revealed>& others) {
      for (const BrickLattice::Revealed& r : some) {
        if (!differs(r, others)) continue;
        for (int i = 0; i < 8; ++i) {
          const Index b = lattice_.find((r.corner - IVec3(i >> 2, i >> 1 & 1, i & 1)) >> 3);
          if (b != kNone) changed_[b] = 1;
        }
      }
    };
    mark(before, lattice_.revealed);
    mark(lattice_.revealed, before);
  }

  const Field& field_;
  Backend& backend_;
  const ChangeMask mask_;
  BrickLattice lattice_;
  const int parts_;                    // of a voxel's edge; 0: the field is no such grid
  std::vector<std::uint8_t> changed_;  // per brick
  std::vector<BrickSigns> signs_;      // per brick, of those that are looked at
};

}  // namespace

BrickLattice resample_lattice(BrickLattice before, const FieldChanges& changes, const Field& field, Backend& backend,
                              std::size_t max_bricks) {
  const double spacing = before.spacing;
  Resampling resampling(std::move(before), changes, field, backend);
  const bool resampled = resampling.run(max_bricks);
  BrickLattice lattice = resampling.finish();
  if (resampled) return lattice;
  return sampling::sample_anew(std::move(lattice), field, backend, spacing, max_bricks);
}

}  // namespace isoskin

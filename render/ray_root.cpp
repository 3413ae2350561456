#include "render/ray_root.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace isoskin {
namespace {

constexpr double kRelativeTolerance = 1e-9;  // of the piece in which one root has been isolated
constexpr double kSmallestShare = 1e-7;      // a piece of a cell that is not split further

bool inside(double f) {
  return f > 0.0;
}

// f(low) and f(high) differ in sign: bisection, hastened by the Illinois variant of regula falsi.
template <class F>
double refine(const F& f, double low, double high, double f_low, double f_high) {
  const double tolerance = kRelativeTolerance * (high - low);
  const bool low_inside = inside(f_low);
  int last_side = 0;
  while (high - low > tolerance) {
    double t = (low * f_high - high * f_low) / (f_high - f_low);
    const double margin = 0.5 * tolerance;
    t = t > low + margin && t < high - margin ? t : std::clamp(t, low + margin, high - margin);
    if (!(t > low && t < high)) t = 0.5 * (low + high);
    if (!(t > low && t < high)) break;
    const double f_t = f(t);
    if (inside(f_t) == low_inside) {
      low = t;
      f_low = f_t;
      if (last_side == -1) f_high *= 0.5;
      last_side = -1;
    } else {
      high = t;
      f_high = f_t;
      if (last_side == 1) f_low *= 0.5;
      last_side = 1;
    }
  }
  return 0.5 * (low + high);
}

template <int N>  // degree
using Bernstein = std::array<double, N + 1>;

// Chebyshev points of [0, 1]: interior, so a sample never lies in the next cell.
template <int N>
double node(int i) {
  return 0.5 - 0.5 * std::cos(std::numbers::pi * (2 * i + 1) / (2 * N + 2));
}

template <int N>
Bernstein<N> basis(double t) {
  Bernstein<N> b{};
  b[0] = 1.0;
  for (int degree = 1; degree <= N; ++degree) {
    for (int i = degree; i > 0; --i) b[i] = (1.0 - t) * b[i] + t * b[i - 1];
    b[0] *= 1.0 - t;
  }
  return b;
}

// Inverse of the matrix of basis functions at the nodes: values to coefficients. Gauss-Jordan with pivoting.
template <int N>
std::array<Bernstein<N>, N + 1> interpolation_matrix() {
  std::array<Bernstein<N>, N + 1> a, inverse{};
  for (int i = 0; i <= N; ++i) {
    a[i] = basis<N>(node<N>(i));
    inverse[i][i] = 1.0;
  }
  for (int column = 0; column <= N; ++column) {
    int pivot = column;
    for (int row = column; row <= N; ++row) {
      if (std::abs(a[row][column]) > std::abs(a[pivot][column])) pivot = row;
    }
    std::swap(a[column], a[pivot]);
    std::swap(inverse[column], inverse[pivot]);
    const double scale = 1.0 / a[column][column];
    for (int k = 0; k <= N; ++k) {
      a[column][k] *= scale;
      inverse[column][k] *= scale;
    }
    for (int row = 0; row <= N; ++row) {
      const double factor = row == column ? 0.0 : a[row][column];
      for (int k = 0; k <= N; ++k) {
        a[row][k] -= factor * a[column][k];
        inverse[row][k] -= factor * inverse[column][k];
      }
    }
  }
  return inverse;
}

template <int N>
Bernstein<N> coefficients(const Field& field, const RayPiece& piece) {
  static const auto matrix = interpolation_matrix<N>();
  Bernstein<N> value, out{};
  for (int i = 0; i <= N; ++i) value[i] = field.value(piece.at(piece.begin + node<N>(i) * (piece.end - piece.begin)));
  for (int i = 0; i <= N; ++i) {
    for (int k = 0; k <= N; ++k) out[i] += matrix[i][k] * value[k];
  }
  return out;
}

template <int N>
double evaluate(Bernstein<N> c, double t) {
  for (int degree = N; degree > 0; --degree) {
    for (int i = 0; i < degree; ++i) c[i] += t * (c[i + 1] - c[i]);
  }
  return c[0];
}

// de Casteljau at 1/2: `c` becomes the left half, the right half is returned.
template <int N>
Bernstein<N> split(Bernstein<N>& c) {
  Bernstein<N> right;
  right[N] = c[N];
  for (int level = 1; level <= N; ++level) {
    for (int i = N; i >= level; --i) c[i] = 0.5 * (c[i - 1] + c[i]);
    right[N - level] = c[N];
  }
  return right;
}

template <int N>
int sign_changes(const Bernstein<N>& c) {
  int changes = 0;
  for (int i = 1; i <= N; ++i) changes += inside(c[i]) != inside(c[i - 1]);
  return changes;
}

// Descartes: as many roots in (0, 1) as sign changes, or fewer by an even number.
template <int N>
std::optional<double> first_root_of(Bernstein<N> c, double begin, double length) {
  const int changes = sign_changes<N>(c);
  if (changes == 0) return std::nullopt;
  if (changes == 1) {
    const double t = refine([&](double s) { return evaluate<N>(c, s); }, 0.0, 1.0, c[0], c[N]);
    return begin + t * length;
  }
  if (length < kSmallestShare) {
    return inside(c[0]) != inside(c[N]) ? std::optional(begin + 0.5 * length) : std::nullopt;
  }
  const Bernstein<N> right = split<N>(c);
  const double half = 0.5 * length;
  if (const auto root = first_root_of<N>(c, begin, half)) return root;
  return first_root_of<N>(right, begin + half, half);
}

template <int N>
std::optional<double> polynomial_root(const Field& field, const RayPiece& piece) {
  const auto share = first_root_of<N>(coefficients<N>(field, piece), 0.0, 1.0);
  if (!share) return std::nullopt;
  return piece.begin + *share * (piece.end - piece.begin);
}

Box box_of(const RayPiece& piece) {
  Box box;
  box.add(piece.at(piece.begin));
  box.add(piece.at(piece.end));
  return box;
}

std::optional<double> bisect(const Field& field, const RayPiece& piece, double f_begin, double f_end, double shortest) {
  const Interval f = field.range(box_of(piece));
  if (f.low > 0.0 || f.high <= 0.0) return std::nullopt;
  if (piece.end - piece.begin <= shortest) {
    if (inside(f_begin) == inside(f_end)) return std::nullopt;
    return refine([&](double t) { return field.value(piece.at(t)); }, piece.begin, piece.end, f_begin, f_end);
  }
  const double middle = 0.5 * (piece.begin + piece.end);
  const double f_middle = field.value(piece.at(middle));
  if (const auto root =
          bisect(field, {piece.origin, piece.direction, piece.begin, middle}, f_begin, f_middle, shortest)) {
    return root;
  }
  return bisect(field, {piece.origin, piece.direction, middle, piece.end}, f_middle, f_end, shortest);
}

}  // namespace

std::optional<double> first_polynomial_root(const Field& field, const RayPiece& piece, int degree) {
  return degree == 3 ? polynomial_root<3>(field, piece) : polynomial_root<9>(field, piece);
}

std::optional<double> first_root(const Field& field, const RayPiece& piece, double shortest) {
  const Interval f = field.range(box_of(piece));
  if (f.low > 0.0 || f.high <= 0.0) return std::nullopt;
  return bisect(field, piece, field.value(piece.at(piece.begin)), field.value(piece.at(piece.end)), shortest);
}

}  // namespace isoskin

#include "core/io/ply.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <numeric>
#include <optional>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "core/parallel.h"

namespace isoskin {
namespace {

static_assert(std::endian::native == std::endian::little, "PLY bytes are copied as they lie in memory");

enum class Scalar { int8, uint8, int16, uint16, int32, uint32, int64, uint64, float32, float64 };

constexpr std::array<std::pair<std::string_view, Scalar>, 18> kScalarNames = {{
    {"char", Scalar::int8},
    {"int8", Scalar::int8},
    {"uchar", Scalar::uint8},
    {"uint8", Scalar::uint8},
    {"short", Scalar::int16},
    {"int16", Scalar::int16},
    {"ushort", Scalar::uint16},
    {"uint16", Scalar::uint16},
    {"int", Scalar::int32},
    {"int32", Scalar::int32},
    {"uint", Scalar::uint32},
    {"uint32", Scalar::uint32},
    {"int64", Scalar::int64},
    {"uint64", Scalar::uint64},
    {"float", Scalar::float32},
    {"float32", Scalar::float32},
    {"double", Scalar::float64},
    {"float64", Scalar::float64},
}};

constexpr std::size_t bytes_of(Scalar type) {
  constexpr std::size_t bytes[] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return bytes[int(type)];
}

constexpr const char* kCriticalPoint = "critical_point";

struct Property {
  std::string name;
  Scalar type = Scalar::float32;
  std::optional<Scalar> count;  // the type of a list's length; a list if there is one
};

struct Element {
  std::string name;
  std::size_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  bool ascii = false;
  std::vector<Element> elements;
  std::vector<std::string> comments;
  std::size_t bytes = 0;
};

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& what) {
  throw InputError(fmt::format("{}: {}", path.string(), what));
}

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  for (std::size_t at = 0;;) {
    at = line.find_first_not_of(" \t\r", at);
    if (at == std::string_view::npos) return words;
    const std::size_t end = std::min(line.find_first_of(" \t\r", at), line.size());
    words.push_back(line.substr(at, end - at));
    at = end;
  }
}

template <class Number>
std::optional<Number> parse(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  Number value{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

class HeaderParser {
public:
  HeaderParser(const std::filesystem::path& path, std::string_view text) : path_(path), text_(text) {}

  Header parse_header() {
    if (const auto first = next_line(); !first || words_of(*first) != std::vector<std::string_view>{"ply"})
      fail(path_, "not a PLY file: expected \"ply\" in line 1");
    bool format_seen = false;
    for (;;) {
      const auto line = next_line();
      if (!line) fail(path_, "truncated: expected end_header");
      const auto words = words_of(*line);
      if (words.empty() || words[0] == "obj_info") continue;
      if (words[0] == "end_header") break;
      if (words[0] == "comment") {
        out_.comments.emplace_back(*line);
      } else if (words[0] == "format") {
        read_format(words);
        format_seen = true;
      } else if (words[0] == "element") {
        read_element(words);
      } else if (words[0] == "property") {
        read_property(words);
      } else {
        fail(path_, fmt::format("line {}: expected element, property, comment or end_header", line_));
      }
    }
    if (!format_seen) fail(path_, "expected a format line in the header");
    out_.bytes = at_;
    return std::move(out_);
  }

private:
  std::optional<std::string_view> next_line() {
    constexpr std::size_t kLongestLine = 4096;  // a file that is not PLY may have no line end at all
    const std::size_t end = text_.substr(at_, kLongestLine).find('\n');
    if (end == std::string_view::npos) return std::nullopt;
    const std::string_view line = text_.substr(at_, end);
    at_ += end + 1;
    ++line_;
    return line;
  }

  void read_format(const std::vector<std::string_view>& words) {
    if (words.size() != 3 || words[2] != "1.0" || (words[1] != "ascii" && words[1] != "binary_little_endian"))
      fail(path_, fmt::format("line {}: expected format binary_little_endian 1.0 or ascii 1.0", line_));
    out_.ascii = words[1] == "ascii";
  }

  void read_element(const std::vector<std::string_view>& words) {
    const auto count = words.size() == 3 ? parse<std::size_t>(words[2]) : std::nullopt;
    if (!count || *count >= kNone) fail(path_, fmt::format("line {}: expected element NAME COUNT", line_));
    out_.elements.push_back({std::string(words[1]), *count, {}});
  }

  void read_property(const std::vector<std::string_view>& words) {
    Property property;
    if (words.size() == 5 && words[1] == "list") {
      property.count = scalar(words[2]);
      property.type = scalar(words[3]);
    } else if (words.size() == 3) {
      property.type = scalar(words[1]);
    } else {
      fail(path_, fmt::format("line {}: expected property TYPE NAME or property list TYPE TYPE NAME", line_));
    }
    if (out_.elements.empty()) fail(path_, fmt::format("line {}: expected an element before its property", line_));
    property.name = words.back();
    out_.elements.back().properties.push_back(std::move(property));
  }

  Scalar scalar(std::string_view name) const {
    for (const auto& [known, type] : kScalarNames)
      if (known == name) return type;
    fail(path_, fmt::format("line {}: unknown type, expected char to double or int8 to float64", line_));
  }

  const std::filesystem::path& path_;
  std::string_view text_;
  std::size_t at_ = 0;
  int line_ = 0;
  Header out_;
};

/// Hands out the numbers behind the header one after another, binary or ascii.
class Numbers {
public:
  Numbers(const std::filesystem::path& path, std::string_view text, bool ascii)
      : path_(path), at_(text.data()), end_(text.data() + text.size()), ascii_(ascii) {}

  double next(Scalar type) { return ascii_ ? next_word() : next_bytes(type); }

  /// Throws before anything is allocated for an element that cannot fit into what is left of the file.
  void expect(const Element& element) const {
    std::size_t least = 0;
    for (const Property& p : element.properties) least += ascii_ ? 2 : bytes_of(p.count.value_or(p.type));
    if (element.properties.empty() || element.count <= (std::size_t(end_ - at_) + (ascii_ ? 1 : 0)) / least) return;
    fail(path_, fmt::format("truncated: expected {} of element {}", element.count, element.name));
  }

private:
  template <class T>
  double take() {
    T value;
    if (std::size_t(end_ - at_) < sizeof(T)) fail(path_, "truncated: the file ends before its elements do");
    std::memcpy(&value, at_, sizeof(T));
    at_ += sizeof(T);
    return double(value);
  }

  double next_bytes(Scalar type) {
    switch (type) {
      case Scalar::int8:
        return take<std::int8_t>();
      case Scalar::uint8:
        return take<std::uint8_t>();
      case Scalar::int16:
        return take<std::int16_t>();
      case Scalar::uint16:
        return take<std::uint16_t>();
      case Scalar::int32:
        return take<std::int32_t>();
      case Scalar::uint32:
        return take<std::uint32_t>();
      case Scalar::int64:
        return take<std::int64_t>();
      case Scalar::uint64:
        return take<std::uint64_t>();
      case Scalar::float32:
        return take<float>();
      case Scalar::float64:
        return take<double>();
    }
    return 0.0;
  }

  double next_word() {
    const auto space = [](char c) { return c == ' ' || (c >= '\t' && c <= '\r'); };
    while (at_ != end_ && space(*at_)) ++at_;
    const char* begin = at_;
    while (at_ != end_ && !space(*at_)) ++at_;
    if (begin == at_) fail(path_, "truncated: the file ends before its elements do");
    const auto value = parse<double>({begin, std::size_t(at_ - begin)});
    if (!value) fail(path_, "expected a number in the body of the ascii file");
    return *value;
  }

  const std::filesystem::path& path_;
  const char* at_;
  const char* end_;
  bool ascii_;
};

/// Three float properties that make one column of the mesh.
struct VectorColumn {
  std::array<std::string_view, 3> names;
  int seen = 0;  // bit k: the file has names[k]
  std::vector<Vec3> values;

  bool whole() const { return seen == 7; }
};

class Reader {
public:
  explicit Reader(const std::filesystem::path& path) : path_(path), text_(slurp(path)) {}

  PlyMesh read() {
    const Header header = HeaderParser(path_, text_).parse_header();
    Numbers numbers(path_, std::string_view(text_).substr(header.bytes), header.ascii);
    read_comments(header.comments);
    for (const Element& element : header.elements) {
      numbers.expect(element);
      if (element.name == "vertex") {
        read_vertices(element, numbers);
      } else if (element.name == "face") {
        read_faces(element, numbers);
      } else if (element.name == kCriticalPoint) {
        read_critical_points(element, numbers);
      } else {
        skip(element, numbers);
      }
    }
    assemble();
    return std::move(out_);
  }

private:
  static std::string slurp(const std::filesystem::path& path) {
    std::error_code error;
    if (std::filesystem::is_directory(path, error)) fail(path, "is a folder, expected a PLY file");
    std::ifstream in(path, std::ios::binary);
    if (!in) fail(path, fmt::format("cannot open: {}", std::strerror(errno)));
    std::string text;
    const auto size = std::filesystem::file_size(path, error);
    if (!error) text.reserve(size);
    std::vector<char> buffer(1 << 20);
    while (in.read(buffer.data(), std::streamsize(buffer.size())), in.gcount() > 0)
      text.append(buffer.data(), std::size_t(in.gcount()));
    if (in.bad()) fail(path, "cannot be read");
    return text;
  }

  void read_comments(const std::vector<std::string>& comments) {
    for (const std::string& comment : comments) {
      const auto words = words_of(comment);
      if (words.size() != 3) continue;
      if (words[1] == "frame") out_.header.frame = parse<int>(words[2]).value_or(0);
      if (words[1] == "time") out_.header.time = parse<double>(words[2]).value_or(0.0);
      if (words[1] == "next_id") next_id_ = parse<Index>(words[2]);
    }
  }

  /// Where a vertex property goes: a component of a vector column, a column of whole numbers, or nowhere.
  struct Target {
    VectorColumn* column = nullptr;
    int component = 0;
    std::vector<Index>* whole = nullptr;
  };

  Target target_of(const Property& property) {
    if (property.count) return {};
    if (property.name == "id") return {nullptr, 0, &id_};
    if (property.name == "age") return {nullptr, 0, &age_};
    for (VectorColumn* column : {&position_, &normal_, &rest_, &velocity_})
      for (int k = 0; k < 3; ++k)
        if (property.name == column->names[k]) return {column, k, nullptr};
    return {};
  }

  void read_vertices(const Element& element, Numbers& numbers) {
    vertices_ = element.count;
    std::vector<Target> targets;
    for (const Property& property : element.properties) {
      targets.push_back(target_of(property));
      if (targets.back().column) targets.back().column->seen |= 1 << targets.back().component;
      if (targets.back().whole) targets.back().whole->assign(vertices_, 0);
    }
    for (VectorColumn* column : {&position_, &normal_, &rest_, &velocity_})
      if (column->whole()) column->values.assign(vertices_, Vec3(0));
    for (std::size_t v = 0; v < vertices_; ++v)
      for (std::size_t p = 0; p < targets.size(); ++p) read_property(element.properties[p], targets[p], v, numbers);
  }

  void read_property(const Property& property, const Target& target, std::size_t v, Numbers& numbers) {
    if (property.count) return skip_list(property, numbers);
    const double value = numbers.next(property.type);
    if (target.column && target.column->whole()) {
      if (!(std::abs(value) <= std::numeric_limits<float>::max()))
        fail(path_, fmt::format("vertex {}: expected a finite float32 {}", v, property.name));
      target.column->values[v][target.component] = float(value);
    } else if (target.whole) {
      if (!(value >= 0.0 && value < double(kNone)) || value != std::floor(value))
        fail(path_, fmt::format("vertex {}: expected a whole {} below 2^32 - 1", v, property.name));
      (*target.whole)[v] = Index(value);
    }
  }

  void read_faces(const Element& element, Numbers& numbers) {
    const auto is_corners = [](const Property& p) {
      return p.count && (p.name == "vertex_indices" || p.name == "vertex_index");
    };
    if (std::count_if(element.properties.begin(), element.properties.end(), is_corners) != 1)
      fail(path_, "expected one list property vertex_indices on element face");
    if (element.count >= kNone / 3) fail(path_, "expected fewer than 2^32 / 3 faces");
    corners_.reserve(3 * element.count);
    for (std::size_t f = 0; f < element.count; ++f)
      for (const Property& property : element.properties) {
        if (!is_corners(property)) {
          skip(property, numbers);
          continue;
        }
        if (const double count = numbers.next(*property.count); count != 3.0)
          fail(path_, fmt::format("face {}: expected a triangle, found {} corners", f, count));
        for (int k = 0; k < 3; ++k) corners_.push_back(corner(numbers.next(property.type), f));
      }
  }

  void read_critical_points(const Element& element, Numbers& numbers) {
    std::vector<DVec3>& points = out_.header.critical_points.emplace();
    const std::vector<Property>& xyz = element.properties;
    if (xyz.size() != 3 || xyz[0].name != "x" || xyz[1].name != "y" || xyz[2].name != "z" ||
        std::any_of(xyz.begin(), xyz.end(), [](const Property& p) { return p.count.has_value(); }))
      fail(path_, fmt::format("expected properties x, y and z of element {}", kCriticalPoint));
    points.resize(element.count);
    for (std::size_t i = 0; i < points.size(); ++i)
      for (int k = 0; k < 3; ++k) {
        points[i][k] = numbers.next(xyz[k].type);
        if (!std::isfinite(points[i][k]))
          fail(path_, fmt::format("{} {}: expected finite {}", kCriticalPoint, i, "xyz"[k]));
      }
  }

  Index corner(double value, std::size_t face) const {
    if (!(value >= 0.0 && value < double(kNone)) || value != std::floor(value))
      fail(path_, fmt::format("face {}: vertex index {} is not a whole number in range", face, value));
    return Index(value);
  }

  static void skip_list(const Property& property, Numbers& numbers) {
    const double count = numbers.next(*property.count);
    for (double k = 0; k < count; ++k) numbers.next(property.type);
  }
  static void skip(const Property& property, Numbers& numbers) {
    if (property.count) return skip_list(property, numbers);
    numbers.next(property.type);
  }
  static void skip(const Element& element, Numbers& numbers) {
    if (element.properties.empty()) return;
    for (std::size_t i = 0; i < element.count; ++i)
      for (const Property& property : element.properties) skip(property, numbers);
  }

  void assemble() {
    if (!position_.whole()) fail(path_, "expected vertex properties x, y and z");
    for (std::size_t c = 0; c < corners_.size(); ++c)
      if (corners_[c] >= vertices_)
        fail(path_, fmt::format("face {}: vertex index {} out of range, expected less than {}", c / 3, corners_[c],
                                vertices_));
    TriangleMesh& mesh = out_.mesh;
    mesh.vertex = std::move(corners_);
    mesh.vertices.rest = rest_.whole() ? std::move(rest_.values) : position_.values;
    mesh.vertices.position = std::move(position_.values);
    mesh.vertices.velocity = std::move(velocity_.values);
    mesh.vertices.age = std::move(age_);
    out_.normals = std::move(normal_.values);
    assemble_ids();
    mesh.vertices.resize(vertices_);
    try {
      link_twins(mesh);
      out_.closed = true;
    } catch (const std::invalid_argument& error) {
      mesh.twin.clear();
      out_.open_reason = error.what();
    }
  }

  void assemble_ids() {
    if (id_.size() != vertices_) {
      id_.resize(vertices_);
      std::iota(id_.begin(), id_.end(), Index(0));
    }
    const Index above = id_.empty() ? 0 : *std::max_element(id_.begin(), id_.end()) + 1;
    if (next_id_ && *next_id_ < above)
      fail(path_, fmt::format("expected ids below the header's next_id {}, found {}", *next_id_, above - 1));
    out_.mesh.next_id = next_id_.value_or(above);
    out_.mesh.vertices.id = std::move(id_);
  }

  const std::filesystem::path& path_;
  std::string text_;
  std::size_t vertices_ = 0;
  VectorColumn position_{{"x", "y", "z"}, 0, {}};
  VectorColumn normal_{{"nx", "ny", "nz"}, 0, {}};
  VectorColumn rest_{{"s", "t", "r"}, 0, {}};
  VectorColumn velocity_{{"vx", "vy", "vz"}, 0, {}};
  std::vector<Index> id_, age_, corners_;
  std::optional<Index> next_id_;
  PlyMesh out_;
};

std::string header_text(const TriangleMesh& mesh, bool normals, const PlyHeader& header) {
  std::string text = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment frame {}\ncomment time {}\ncomment next_id {}\nelement vertex "
      "{}\n",
      header.frame, header.time, mesh.next_id, mesh.vertex_count());
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz", "s", "t", "r", "vx", "vy", "vz"})
    if (normals || name[0] != 'n') text += fmt::format("property float {}\n", name);
  text += "property uint id\nproperty uint age\n";
  text += fmt::format("element face {}\nproperty list uchar uint vertex_indices\n", mesh.triangle_count());
  if (header.critical_points) {
    text += fmt::format("element {} {}\n", kCriticalPoint, header.critical_points->size());
    for (const char* name : {"x", "y", "z"}) text += fmt::format("property double {}\n", name);
  }
  return text + "end_header\n";
}

/// A file under a temporary name that vanishes unless it is committed.
class TemporaryFile {
public:
  explicit TemporaryFile(const std::filesystem::path& target) : target_(target) {
    static std::atomic<unsigned> count{0};
    do {  // a name may be taken by what a killed run with our process number left behind
      temporary_ = target.parent_path() / fmt::format(".isoskin-{}-{}.tmp", ::getpid(), count++);
      file_ = ::open(temporary_.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
    } while (file_ < 0 && errno == EEXIST);
    if (file_ < 0) fail_with(errno);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile() {
    if (file_ >= 0) ::close(file_);
    if (!committed_) ::unlink(temporary_.c_str());
  }

  void write(std::span<const char> bytes) {
    while (!bytes.empty()) {
      const ssize_t written = ::write(file_, bytes.data(), bytes.size());
      if (written < 0 && errno == EINTR) continue;
      if (written < 0) fail_with(errno);
      bytes = bytes.subspan(std::size_t(written));
    }
  }

  void commit() {
    if (::fsync(file_) != 0) fail_with(errno);
    if (::close(std::exchange(file_, -1)) != 0) fail_with(errno);
    if (::rename(temporary_.c_str(), target_.c_str()) != 0) fail_with(errno);
    committed_ = true;
  }

private:
  [[noreturn]] void fail_with(int error) {
    throw InputError(fmt::format("cannot write {}: {}", target_.string(), std::strerror(error)));
  }

  std::filesystem::path target_, temporary_;
  int file_ = -1;
  bool committed_ = false;
};

}  // namespace

void write_file_atomically(const std::filesystem::path& path, std::span<const char> bytes) {
  TemporaryFile file(path);
  file.write(bytes);
  file.commit();
}

std::vector<char> ply_bytes(const TriangleMesh& mesh, std::span<const Vec3> normals, const PlyHeader& header) {
  if (!normals.empty() && normals.size() != mesh.vertex_count())
    throw std::invalid_argument(
        fmt::format("write_ply: {} normals for {} vertices", normals.size(), mesh.vertex_count()));
  const std::string text = header_text(mesh, !normals.empty(), header);
  const std::size_t row = 4 * (normals.empty() ? 11 : 14), face = 1 + 3 * sizeof(Index);
  const std::span<const DVec3> critical = header.critical_points ? *header.critical_points : std::span<const DVec3>();
  std::vector<char> bytes(text.size() + row * mesh.vertex_count() + face * mesh.triangle_count() +
                          critical.size_bytes());
  std::copy(text.begin(), text.end(), bytes.begin());

  char* const vertices = bytes.data() + text.size();
  for_each_index(mesh.vertex_count(), [&](std::size_t v) {
    char* out = vertices + row * v;
    const auto put = [&](const auto& value) {
      std::memcpy(out, &value, sizeof(value));
      out += sizeof(value);
    };
    put(mesh.vertices.position[v]);
    if (!normals.empty()) put(normals[v]);
    put(mesh.vertices.rest[v]);
    put(mesh.vertices.velocity[v]);
    put(mesh.vertices.id[v]);
    put(mesh.vertices.age[v]);
  });
  char* const faces = vertices + row * mesh.vertex_count();
  for_each_index(mesh.triangle_count(), [&](std::size_t t) {
    faces[face * t] = 3;
    std::memcpy(faces + face * t + 1, &mesh.vertex[3 * t], 3 * sizeof(Index));
  });
  if (!critical.empty()) std::memcpy(faces + face * mesh.triangle_count(), critical.data(), critical.size_bytes());
  return bytes;
}

void write_ply(const std::filesystem::path& path, const TriangleMesh& mesh, std::span<const Vec3> normals,
               const PlyHeader& header) {
  write_file_atomically(path, ply_bytes(mesh, normals, header));
}

PlyMesh read_ply(const std::filesystem::path& path) {
  return Reader(path).read();
}

}  // namespace isoskin

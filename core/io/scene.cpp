#include "core/io/scene.h"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numeric>
#include <sstream>
#include <string_view>
#include <vector>

#include "core/field/blend_graph.h"
#include "core/io/frame_files.h"
#include "core/io/key_track.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;

constexpr double kDefaultFrameDuration = 1.0 / 24.0;
constexpr std::int64_t kMostFrames = 999'999'999;

// Reads nodes of one file; whatever is not as expected ends with "FILE:LINE: what".
class Reader {
public:
  explicit Reader(fs::path file) : file_(std::move(file)) {}

  [[noreturn]] void fail(const toml::source_region& at, const std::string& what) const {
    throw InputError(fmt::format("{}:{}: {}", file_.string(), at.begin.line, what));
  }
  [[noreturn]] void fail(const toml::node& at, const std::string& what) const { fail(at.source(), what); }

  void allow_keys(const toml::table& table, const std::vector<std::string_view>& keys) const {
    for (auto&& [key, node] : table) {
      if (std::find(keys.begin(), keys.end(), key.str()) != keys.end()) continue;
      fail(key.source(), fmt::format("unknown key {}, expected one of: {}", key.str(), fmt::join(keys, ", ")));
    }
  }

  double number(const toml::node& node, std::string_view what) const {
    const auto value = node.is_number() ? node.value<double>() : std::nullopt;
    if (!value) fail(node, fmt::format("{}: expected a number, found {}", what, kind_of(node)));
    if (!std::isfinite(*value)) fail(node, fmt::format("{}: expected a finite number", what));
    return *value;
  }
  double positive(const toml::node& node, std::string_view what) const {
    const double value = number(node, what);
    if (!(value > 0.0)) fail(node, fmt::format("{}: expected a positive number, found {}", what, value));
    return value;
  }
  int integer(const toml::node& node, std::string_view what) const {
    const auto value = node.is_integer() ? node.value<std::int64_t>() : std::nullopt;
    if (!value) fail(node, fmt::format("{}: expected an integer, found {}", what, kind_of(node)));
    if (*value < 0 || *value > kMostFrames)
      fail(node, fmt::format("{}: expected an integer from 0 to {}", what, kMostFrames));
    return static_cast<int>(*value);
  }
  bool boolean(const toml::node& node, std::string_view what) const {
    if (!node.is_boolean()) fail(node, fmt::format("{}: expected true or false, found {}", what, kind_of(node)));
    return *node.value<bool>();
  }
  std::string text(const toml::node& node, std::string_view what) const {
    if (!node.is_string()) fail(node, fmt::format("{}: expected a string, found {}", what, kind_of(node)));
    return *node.value<std::string>();
  }
  DVec3 vector(const toml::node& node, std::string_view what) const {
    const toml::array* array = node.as_array();
    if (!array || array->size() != 3) fail(node, fmt::format("{}: expected three numbers [x, y, z]", what));
    return {number((*array)[0], what), number((*array)[1], what), number((*array)[2], what)};
  }
  /// The index of the word in `words`.
  std::size_t choice(const toml::node& node, std::string_view what,
                     std::initializer_list<std::string_view> words) const {
    const std::string word = text(node, what);
    const auto at = std::find(words.begin(), words.end(), word);
    if (at == words.end())
      fail(node, fmt::format("{}: expected one of: {}; found {}", what, fmt::join(words, ", "), word));
    return static_cast<std::size_t>(at - words.begin());
  }
  const toml::table& table(const toml::node& node, std::string_view what) const {
    if (!node.is_table()) fail(node, fmt::format("{}: expected a table, found {}", what, kind_of(node)));
    return *node.as_table();
  }
  const toml::array& array(const toml::node& node, std::string_view what) const {
    if (!node.is_array()) fail(node, fmt::format("{}: expected an array, found {}", what, kind_of(node)));
    return *node.as_array();
  }
  const fs::path& file() const { return file_; }

private:
  static std::string kind_of(const toml::node& node) {
    std::ostringstream out;
    out << node.type();
    return out.str();
  }
  fs::path file_;
};

enum class Kind : std::uint8_t { point, segment, triangle, box };

/// The names of the vectors that place an element, in the order of ElementTracks::place.
std::vector<std::string_view> places_of(Kind kind) {
  switch (kind) {
    case Kind::point:
      return {"position"};
    case Kind::segment:
      return {"a", "b"};
    case Kind::triangle:
      return {"a", "b", "c"};
    case Kind::box:
      return {"position", "size", "rotation"};
  }
  return {};
}

/// v turned about the direction of `turn` by its length, in degrees.
DVec3 turned(const DVec3& v, const DVec3& turn) {
  const double degrees = glm::length(turn);
  if (!(degrees > 0.0)) return v;
  const DVec3 axis = turn / degrees;
  const double angle = glm::radians(degrees);
  return std::cos(angle) * v + std::sin(angle) * glm::cross(axis, v) +
         (1.0 - std::cos(angle)) * glm::dot(axis, v) * axis;
}

struct ElementTracks {
  SkeletonElement fixed;  // norm, potential, shape
  Kind kind = Kind::point;
  std::vector<KeyTrack<DVec3>> place;
  KeyTrack<double> radius, weight;

  SkeletonElement at(double frame) const {
    SkeletonElement e = fixed;
    e.radius = radius.at(frame);
    e.weight = weight.at(frame);
    e.a = e.b = place[0].at(frame);
    if (kind == Kind::segment || kind == Kind::triangle) e.b = place[1].at(frame);
    if (kind == Kind::triangle) e.c = place[2].at(frame);
    if (kind == Kind::box) set_box(e, place[1].at(frame), place[2].at(frame));
    return e;
  }

private:
  /// Sides shorter than nothing, which a smooth motion may swing to, are nothing.
  static void set_box(SkeletonElement& e, const DVec3& size, const DVec3& rotation) {
    const DVec3 side = glm::max(size, DVec3(0.0));
    e.a -= turned(0.5 * side, rotation);
    e.b = e.a + turned(DVec3(side.x, 0.0, 0.0), rotation);
    e.c = e.a + turned(DVec3(0.0, side.y, 0.0), rotation);
    e.d = e.a + turned(DVec3(0.0, 0.0, side.z), rotation);
  }
};

// A parameter's keys: its fixed value, or those of `keys` that name it.
template <typename T, typename Read>
KeyTrack<T> read_track(const Reader& reader, const toml::table& element, const std::vector<const toml::table*>& keys,
                       std::string_view name, Motion motion, std::optional<T> otherwise, const Read& read) {
  KeyTrack<T> track;
  track.motion = motion;
  const toml::node* fixed = element.get(name);
  if (fixed) track.add(0.0, read(*fixed, name));
  for (const toml::table* key : keys) {
    const toml::node* node = key->get(name);
    if (!node) continue;
    if (fixed) reader.fail(*node, fmt::format("{} is given for the whole element too; expected it in one place", name));
    track.add(reader.number(*key->get("frame"), "frame"), read(*node, name));
  }
  if (!track.frame.empty()) return track;
  if (!otherwise)
    reader.fail(element, fmt::format("element without {}, expected it in the element or in its keys", name));
  track.add(0.0, *otherwise);
  return track;
}

std::vector<const toml::table*> read_keys(const Reader& reader, const toml::table& element,
                                          std::vector<std::string_view> names) {
  std::vector<const toml::table*> keys;
  const toml::node* node = element.get("keys");
  if (!node) return keys;
  names.insert(names.begin(), "frame");
  names.insert(names.end(), {"radius", "weight"});
  double last = -std::numeric_limits<double>::infinity();
  for (const toml::node& entry : reader.array(*node, "keys")) {
    const toml::table& key = reader.table(entry, "keys");
    reader.allow_keys(key, names);
    const toml::node* frame = key.get("frame");
    if (!frame) reader.fail(key, "key without frame");
    const double at = reader.number(*frame, "frame");
    if (at <= last) reader.fail(*frame, "keys: expected frames in increasing order");
    last = at;
    keys.push_back(&key);
  }
  if (keys.empty()) reader.fail(*node, "keys: expected at least one key");
  return keys;
}

ElementTracks read_element(const Reader& reader, const toml::table& table) {
  ElementTracks element;
  if (const auto* node = table.get("kind"))
    element.kind = static_cast<Kind>(reader.choice(*node, "kind", {"point", "segment", "triangle", "box"}));
  if (element.kind == Kind::triangle) element.fixed.shape = Shape::triangle;
  if (element.kind == Kind::box) element.fixed.shape = Shape::box;
  const std::vector<std::string_view> places = places_of(element.kind);
  std::vector<std::string_view> names{"kind", "potential", "norm", "motion"};
  names.insert(names.end(), places.begin(), places.end());
  names.insert(names.end(), {"radius", "weight", "keys"});
  reader.allow_keys(table, names);
  if (const auto* node = table.get("potential")) {
    element.fixed.potential = static_cast<Potential>(
        reader.choice(*node, "potential", {"inverse_square", "cauchy", "metaball", "blinn", "wyvill"}));
  }
  if (const auto* node = table.get("norm")) element.fixed.norm = reader.positive(*node, "norm");
  Motion motion = Motion::linear;
  if (const auto* node = table.get("motion"))
    motion = static_cast<Motion>(reader.choice(*node, "motion", {"linear", "smooth"}));

  const std::vector<const toml::table*> keys = read_keys(reader, table, places);
  const auto vector = [&](const toml::node& node, std::string_view what) { return reader.vector(node, what); };
  const auto number = [&](const toml::node& node, std::string_view what) { return reader.number(node, what); };
  const auto positive = [&](const toml::node& node, std::string_view what) { return reader.positive(node, what); };
  const auto sides = [&](const toml::node& node, std::string_view what) {
    const DVec3 size = reader.vector(node, what);
    if (!(std::min({size.x, size.y, size.z}) >= 0.0)) reader.fail(node, fmt::format("{}: expected none below 0", what));
    return size;
  };
  for (const std::string_view name : places) {
    const auto otherwise = name == "rotation" ? std::optional(DVec3(0.0)) : std::nullopt;
    element.place.push_back(name == "size" ? read_track<DVec3>(reader, table, keys, name, motion, otherwise, sides)
                                           : read_track<DVec3>(reader, table, keys, name, motion, otherwise, vector));
  }
  element.radius = read_track<double>(reader, table, keys, "radius", motion, 1.0, positive);
  element.weight = read_track<double>(reader, table, keys, "weight", motion, 1.0, number);
  return element;
}

class SkeletonSource final : public FieldSource {
public:
  std::string name_;
  int begin_ = 1;  // where time is zero
  int first_ = 1, last_ = 1;
  double dt_ = kDefaultFrameDuration;
  double iso_ = 0.0;
  std::vector<ElementTracks> elements_;
  std::vector<std::vector<Index>> groups_;  // that blend

  int first_frame() const override { return first_; }
  int last_frame() const override { return last_; }
  double frame_duration() const override { return dt_; }
  std::string name() const override { return name_; }
  FieldFrame load(int frame) override {
    if (frame < first_ || frame > last_) {
      throw InputError(fmt::format("{}: no frame {}, expected {} to {}", name_, frame, first_, last_));
    }
    std::vector<SkeletonElement> pose;
    for (const ElementTracks& element : elements_) pose.push_back(element.at(frame));
    return {frame, (frame - begin_) * dt_, blended(std::move(pose), iso_, groups_), nullptr};
  }
};

struct FrameRange {
  int first = 1, last = 1;
};

std::optional<FrameRange> read_frames(const Reader& reader, const toml::table& root) {
  const toml::node* node = root.get("frames");
  if (!node) return std::nullopt;
  const toml::array& array = reader.array(*node, "frames");
  if (array.size() != 2) reader.fail(*node, "frames: expected [first, last]");
  const FrameRange range{reader.integer(array[0], "frames"), reader.integer(array[1], "frames")};
  if (range.first > range.last) reader.fail(*node, "frames: expected the first not to exceed the last");
  return range;
}

SceneMeshing read_meshing(const Reader& reader, const toml::table& root) {
  SceneMeshing meshing;
  const toml::node* node = root.get("meshing");
  if (!node) return meshing;
  const toml::table& table = reader.table(*node, "meshing");
  reader.allow_keys(table, {"edge_length", "angle", "passes", "sagitta", "sharp"});
  if (const auto* n = table.get("edge_length")) meshing.edge_length = reader.positive(*n, "edge_length");
  if (const auto* n = table.get("angle")) {
    meshing.angle = reader.positive(*n, "angle");
    if (*meshing.angle >= 180.0) reader.fail(*n, "angle: expected degrees under 180");
  }
  if (const auto* n = table.get("sagitta")) meshing.sagitta = reader.number(*n, "sagitta");
  if (const auto* n = table.get("passes")) meshing.passes = reader.integer(*n, "passes");
  if (const auto* n = table.get("sharp")) meshing.sharp = reader.boolean(*n, "sharp");
  return meshing;
}

/// All elements are one group, unless `blend` names the pairs that blend.
std::vector<std::vector<Index>> read_blend(const Reader& reader, const toml::table& root, std::size_t elements) {
  const toml::node* node = root.get("blend");
  if (!node) {
    std::vector<Index> all(elements);
    std::iota(all.begin(), all.end(), Index{0});
    return {all};
  }
  constexpr std::string_view kPairs = "pairs of elements, numbered from 1";
  std::vector<BlendEdge> edges;
  for (const toml::node& entry : reader.array(*node, "blend")) {
    const toml::array& pair = reader.array(entry, "blend");
    if (pair.size() != 2) reader.fail(entry, fmt::format("blend: expected {}", kPairs));
    BlendEdge edge{};
    for (std::size_t k = 0; k < 2; ++k) {
      const int element = reader.integer(pair[k], "blend");
      if (element < 1 || std::size_t(element) > elements)
        reader.fail(pair[k], fmt::format("blend: no element {}, expected {}, to {}", element, kPairs, elements));
      edge[k] = Index(element - 1);
    }
    if (edge[0] == edge[1]) reader.fail(entry, fmt::format("blend: one element twice, expected {}", kPairs));
    edges.push_back(edge);
  }
  try {
    return blend_groups(elements, edges);
  } catch (const InputError& error) {
    reader.fail(*node, error.what());
  }
}

std::unique_ptr<FieldSource> read_skeleton(const Reader& reader, const toml::table& root, const std::string& name,
                                           const SequenceOptions& overrides) {
  auto source = std::make_unique<SkeletonSource>();
  source->name_ = name;
  const toml::node* iso = root.get("iso");
  if (!iso) reader.fail(root, "scene without iso, expected a number: the field's value on the surface");
  source->iso_ = reader.number(*iso, "iso");
  const FrameRange frames = read_frames(reader, root).value_or(FrameRange{});
  source->begin_ = frames.first;
  source->first_ = overrides.first.value_or(frames.first);
  source->last_ = overrides.last.value_or(frames.last);
  if (source->first_ > source->last_ || source->first_ < frames.first || source->last_ > frames.last) {
    throw InputError(fmt::format("{}: no frames {} to {}; the scene has {} to {}", reader.file().string(),
                                 source->first_, source->last_, frames.first, frames.last));
  }
  if (const auto* node = root.get("dt")) source->dt_ = reader.positive(*node, "dt");
  source->dt_ = overrides.dt.value_or(source->dt_);
  const toml::node& node = *root.get("element");
  for (const toml::node& entry : reader.array(node, "element")) {
    source->elements_.push_back(read_element(reader, reader.table(entry, "element")));
  }
  if (source->elements_.empty()) reader.fail(node, "element: expected at least one [[element]]");
  source->groups_ = read_blend(reader, root, source->elements_.size());
  return source;
}

// What the caller has set wins over the scene.
SequenceOptions read_sequence_options(const Reader& reader, const toml::table& root, const toml::table& table,
                                      const SequenceOptions& overrides) {
  SequenceOptions options = overrides;
  GridOptions& grid = options.grid;
  if (const auto frames = read_frames(reader, root)) {
    options.first = overrides.first.value_or(frames->first);
    options.last = overrides.last.value_or(frames->last);
  }
  if (const auto* node = root.get("dt")) {
    const double dt = reader.positive(*node, "dt");
    options.dt = overrides.dt.value_or(dt);
  }
  if (const auto* node = table.get("grid")) {
    const std::string name = reader.text(*node, "grid");
    if (overrides.grid.grid.empty()) grid.grid = name;
  }
  if (const auto* node = table.get("velocity")) {
    const std::string name = reader.text(*node, "velocity");
    if (overrides.grid.velocity.empty()) grid.velocity = name;
  }
  if (const auto* node = table.get("iso")) {
    const double iso = reader.number(*node, "iso");
    if (!overrides.grid.iso_given) grid.iso = iso;
    grid.iso_given = true;
  }
  if (const auto* node = table.get("smooth")) {
    const int smooth = reader.integer(*node, "smooth");
    if (overrides.grid.smooth == 0) grid.smooth = smooth;
  }
  if (const auto* node = table.get("interpolation")) {
    const bool linear = reader.choice(*node, "interpolation", {"linear", "cubic"}) == 0;
    if (linear) grid.interpolation = Interpolation::linear;
  }
  return options;
}

std::unique_ptr<FieldSource> read_sequence(const Reader& reader, const toml::table& root,
                                           const SequenceOptions& overrides) {
  if (const auto* iso = root.get("iso")) reader.fail(*iso, "iso: expected it in [sequence]");
  if (const auto* blend = root.get("blend")) reader.fail(*blend, "blend: expected it with [[element]] only");
  const toml::table& table = reader.table(*root.get("sequence"), "sequence");
  reader.allow_keys(table, {"files", "grid", "iso", "smooth", "interpolation", "velocity"});
  const toml::node* files = table.get("files");
  if (!files) reader.fail(table, "sequence without files, expected a pattern, a folder, a glob or a file");
  const SequenceOptions options = read_sequence_options(reader, root, table, overrides);
  const fs::path input = reader.file().parent_path() / reader.text(*files, "files");
  try {
    return open_sequence(input.string(), options);
  } catch (const InputError& error) {
    reader.fail(*files, error.what());
  }
}

// A source under another name.
class NamedSource final : public FieldSource {
public:
  NamedSource(std::unique_ptr<FieldSource> source, std::string name)
      : source_(std::move(source)), name_(std::move(name)) {}
  int first_frame() const override { return source_->first_frame(); }
  int last_frame() const override { return source_->last_frame(); }
  double frame_duration() const override { return source_->frame_duration(); }
  FieldFrame load(int frame) override { return source_->load(frame); }
  std::string name() const override { return name_; }

private:
  std::unique_ptr<FieldSource> source_;
  std::string name_;
};

toml::table parse(const fs::path& file) {
  if (!fs::exists(file)) throw InputError(fmt::format("{}: no such file", file.string()));
  if (fs::is_directory(file)) throw InputError(fmt::format("{}: is a folder, expected a scene", file.string()));
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw InputError(fmt::format("{}: cannot be read", file.string()));
  try {
    return toml::parse(stream, file.string());
  } catch (const toml::parse_error& error) {
    std::string what(error.description());
    std::replace(what.begin(), what.end(), '\n', ' ');
    throw InputError(fmt::format("{}:{}: {}", file.string(), error.source().begin.line, what));
  }
}

}  // namespace

Scene load_scene(const fs::path& file, const SequenceOptions& overrides) {
  const Reader reader(file);
  const toml::table root = parse(file);
  reader.allow_keys(root, {"name", "frames", "dt", "iso", "blend", "meshing", "element", "sequence"});
  std::optional<std::string> name;
  if (const auto* node = root.get("name")) {
    name = reader.text(*node, "name");
    if (name->empty() || name->find_first_of("/\\%\n") != std::string::npos) {
      reader.fail(*node, "name: expected a word that can begin a file name");
    }
  }
  const bool skeleton = root.contains("element"), sequence = root.contains("sequence");
  if (skeleton == sequence) reader.fail(root, "expected either [[element]] or [sequence]");
  Scene scene;
  scene.meshing = read_meshing(reader, root);
  if (skeleton) {
    scene.source = read_skeleton(reader, root, name.value_or(file.stem().string()), overrides);
  } else {
    scene.source = read_sequence(reader, root, overrides);
    if (name) scene.source = std::make_unique<NamedSource>(std::move(scene.source), *name);
  }
  return scene;
}

Scene open_input(const std::string& input, const SequenceOptions& options) {
  if (fs::path(input).extension() == ".toml") return load_scene(input, options);
  return {open_sequence(input, options), {}};
}

}  // namespace isoskin

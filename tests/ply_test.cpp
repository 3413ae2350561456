#include "core/io/ply.h"

#include <sys/resource.h>
#include <unistd.h>

#include <bit>
#include <csignal>
#include <cstring>
#include <fstream>
#include <limits>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "core/mesh/validate.h"
#include "tests/test_meshes.h"

using namespace isoskin;
using namespace isoskin::test_meshes;
namespace fs = std::filesystem;
using testing::HasSubstr;

namespace {

/// A folder of its own that vanishes with it.
class Folder {
public:
  Folder() : path_(fs::temp_directory_path() / fmt::format("isoskin_ply_test_{}_{}", ::getpid(), count_++)) {
    fs::create_directories(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  fs::path operator/(const char* name) const { return path_ / name; }
  std::size_t files() const { return std::size_t(std::distance(fs::directory_iterator(path_), {})); }
  const fs::path& path() const { return path_; }

private:
  static inline int count_ = 0;
  fs::path path_;
};

std::string slurp(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

fs::path spill(const Folder& folder, const std::string& text) {
  const fs::path path = folder / "in.ply";
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

/// The message read_ply fails with; it must name the file and be one line.
std::string read_error(const std::string& text) {
  const Folder folder;
  const fs::path path = spill(folder, text);
  try {
    read_ply(path);
  } catch (const InputError& error) {
    const std::string what = error.what();
    EXPECT_THAT(what, HasSubstr(path.string()));
    EXPECT_EQ(what.find('\n'), std::string::npos);
    return what;
  }
  return "read without error";
}

template <class Write>
std::string write_error(const Write& write) {
  try {
    write();
  } catch (const InputError& error) {
    return error.what();
  }
  return "written without error";
}

TriangleMesh rich_mesh() {
  TriangleMesh mesh = icosphere(2);
  for (Index v = 0; v < mesh.vertex_count(); ++v) {
    mesh.vertices.rest[v] = Vec3(0.1f, -0.2f, 3e-40f) * float(v);
    mesh.vertices.velocity[v] = Vec3(-0.0f, 1e30f, float(v) / 3.0f);
    mesh.vertices.id[v] = 3000000000u + 7 * v;
    mesh.vertices.age[v] = v % 5;
  }
  mesh.next_id = 4000000000u;
  return mesh;
}

template <class T>
void expect_same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_TRUE(a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

void expect_same(const TriangleMesh& a, const TriangleMesh& b) {
  EXPECT_EQ(a.vertex, b.vertex);
  EXPECT_EQ(a.twin, b.twin);
  EXPECT_EQ(a.next_id, b.next_id);
  expect_same_bytes(a.vertices.position, b.vertices.position);
  expect_same_bytes(a.vertices.rest, b.vertices.rest);
  expect_same_bytes(a.vertices.velocity, b.vertices.velocity);
  EXPECT_EQ(a.vertices.id, b.vertices.id);
  EXPECT_EQ(a.vertices.age, b.vertices.age);
}

const char* const kAsciiTetrahedron =
    "ply\r\nformat ascii 1.0\ncomment by hand\nelement vertex 4\nproperty double x\nproperty float64 y\n"
    "property short z\nproperty uchar red\nelement face 4\nproperty list uchar int vertex_index\n"
    "property list uchar float texcoord\nelement edge 2\nproperty int from\nend_header\n"
    "0 0 0 255\n1e0 0 0 7\n+0 1.0 0 9\n0 0 1 1\n3 0 2 1 0\n3 0 1 3 2 0.5 0.25\n3 1 2 3 0\n3 0 3 2 0\n5\n6\n";

}  // namespace

TEST(Ply, RoundTripIsExact) {
  const Folder folder;
  const TriangleMesh mesh = rich_mesh();
  const std::vector<Vec3>& normals = mesh.vertices.position;
  write_ply(folder / "a.ply", mesh, normals, {17, 0.1 + 0.2});
  const PlyMesh back = read_ply(folder / "a.ply");
  EXPECT_TRUE(back.closed) << back.open_reason;
  EXPECT_EQ(back.header.frame, 17);
  EXPECT_EQ(back.header.time, 0.1 + 0.2);
  expect_same(back.mesh, mesh);
  expect_same_bytes(back.normals, normals);
  EXPECT_TRUE(validate(back.mesh)) << validate(back.mesh).reason;
  EXPECT_EQ(folder.files(), 1u);

  write_ply(folder / "b.ply", back.mesh, back.normals, back.header);
  EXPECT_EQ(slurp(folder / "a.ply"), slurp(folder / "b.ply"));
}

TEST(Ply, CriticalPointsComeBackAsTheyWere) {
  const Folder folder;
  const std::vector<DVec3> points{{0.1 + 0.2, -1e300, 5e-324}, {1.0 / 3.0, -0.0, 2.0}};
  for (const auto& some :
       {std::optional(points), std::optional(std::vector<DVec3>()), decltype(std::optional(points))()}) {
    write_ply(folder / "a.ply", tetrahedron(), {}, {1, 0.0, some});
    const PlyMesh back = read_ply(folder / "a.ply");
    EXPECT_TRUE(back.header.critical_points == some);
    expect_same(back.mesh, tetrahedron());
  }
  write_ply(folder / "bad.ply", tetrahedron(), {}, {1, 0.0, std::vector{DVec3(std::nan(""))}});
  EXPECT_THROW(read_ply(folder / "bad.ply"), InputError);
}

TEST(Ply, LayoutIsTheDocumentedOne) {
  const Folder folder;
  write_ply(folder / "a.ply", tetrahedron(), tetrahedron().vertices.position, {3, 0.5});
  const std::string text = slurp(folder / "a.ply");
  const std::string header =
      "ply\nformat binary_little_endian 1.0\ncomment frame 3\ncomment time 0.5\ncomment next_id 4\nelement vertex 4\n"
      "property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
      "property float s\nproperty float t\nproperty float r\nproperty float vx\nproperty float vy\nproperty float vz\n"
      "property uint id\nproperty uint age\nelement face 4\nproperty list uchar uint vertex_indices\nend_header\n";
  EXPECT_EQ(text.substr(0, header.size()), header);
  EXPECT_EQ(text.size(), header.size() + 4 * 56 + 4 * 13);
  float x = 0;
  std::memcpy(&x, text.data() + header.size(), 4);
  EXPECT_EQ(x, tetrahedron().position(0).x);
}

TEST(Ply, EmptyAndNormalFreeMeshes) {
  const Folder folder;
  write_ply(folder / "none.ply", TriangleMesh{}, {});
  EXPECT_TRUE(read_ply(folder / "none.ply").mesh.empty());
  write_ply(folder / "plain.ply", torus(5, 4), {});
  const PlyMesh back = read_ply(folder / "plain.ply");
  EXPECT_TRUE(back.normals.empty());
  expect_same(back.mesh, torus(5, 4));
  EXPECT_THROW(write_ply(folder / "bad.ply", tetrahedron(), std::vector<Vec3>(3)), std::invalid_argument);
}

TEST(Ply, ReadsForeignAsciiWithOtherTypesAndProperties) {
  const Folder folder;
  const PlyMesh got = read_ply(spill(folder, kAsciiTetrahedron));
  EXPECT_TRUE(got.closed) << got.open_reason;
  EXPECT_EQ(got.mesh.vertex, (std::vector<Index>{0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2}));
  EXPECT_EQ(got.mesh.position(2), Vec3(0, 1, 0));
  EXPECT_EQ(got.mesh.vertices.rest, got.mesh.vertices.position);
  EXPECT_EQ(got.mesh.vertices.id, (std::vector<Index>{0, 1, 2, 3}));
  EXPECT_EQ(got.mesh.next_id, 4u);
  EXPECT_TRUE(validate(got.mesh)) << validate(got.mesh).reason;
}

TEST(Ply, ReadsEveryBinaryScalarType) {
  const auto raw = [](auto value) {
    std::string bytes(sizeof(value), '\0');
    std::memcpy(bytes.data(), &value, sizeof(value));
    return bytes;
  };
  std::string text =
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty char x\nproperty short y\nproperty double z\n"
      "property int64 id\nproperty uchar age\nproperty list ushort uint64 extra\nelement face 1\n"
      "property list int16 uint16 vertex_indices\nproperty uint32 flags\nend_header\n";
  for (int v = 0; v < 3; ++v)
    text += raw(std::int8_t(-v)) + raw(std::int16_t(-300 * v)) + raw(0.25 * v) + raw(std::int64_t(40 + v)) +
            raw(std::uint8_t(v)) + raw(std::uint16_t(v)) + std::string(8 * std::size_t(v), 'x');
  text += raw(std::int16_t(3)) + raw(std::uint16_t(0)) + raw(std::uint16_t(1)) + raw(std::uint16_t(2)) + raw(9u);
  const Folder folder;
  const PlyMesh got = read_ply(spill(folder, text));
  EXPECT_EQ(got.mesh.position(2), Vec3(-2, -600, 0.5f));
  EXPECT_EQ(got.mesh.vertices.id, (std::vector<Index>{40, 41, 42}));
  EXPECT_EQ(got.mesh.vertices.age, (std::vector<Index>{0, 1, 2}));
  EXPECT_EQ(got.mesh.next_id, 43u);
  EXPECT_FALSE(got.closed);
  EXPECT_THAT(got.open_reason, HasSubstr("edge 0-1"));
  EXPECT_TRUE(got.mesh.twin.empty());
}

TEST(Ply, EveryTruncationIsAnInputError) {
  const Folder folder;
  write_ply(folder / "a.ply", tetrahedron(), tetrahedron().vertices.position);
  const std::string text = slurp(folder / "a.ply");
  for (std::size_t size = 0; size < text.size(); ++size)
    EXPECT_THROW(read_ply(spill(folder, text.substr(0, size))), InputError) << size;
  const std::string ascii = kAsciiTetrahedron;
  for (std::size_t size = 0; size + 2 < ascii.size(); ++size)
    EXPECT_THROW(read_ply(spill(folder, ascii.substr(0, size))), InputError) << size;
}

RC_GTEST_PROP(Ply, DamagedBytesNeverCrash, ()) {
  const Folder folder;
  write_ply(folder / "a.ply", torus(3, 3), torus(3, 3).vertices.position);
  std::string text = *rc::gen::arbitrary<bool>() ? slurp(folder / "a.ply") : kAsciiTetrahedron;
  const int hits = *rc::gen::inRange(1, 6);
  for (int i = 0; i < hits; ++i) text[*rc::gen::inRange<std::size_t>(0, text.size())] = *rc::gen::arbitrary<char>();
  try {
    const PlyMesh got = read_ply(spill(folder, text));
    for (const Vec3& p : got.mesh.vertices.position)
      RC_ASSERT(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z));
    for (const Index v : got.mesh.vertex) RC_ASSERT(v < got.mesh.vertex_count());
  } catch (const InputError&) {
  }
}

TEST(Ply, SaysWhatIsWrong) {
  const std::string v = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string ascii = "ply\nformat ascii 1.0\n",
                    face = "element face 1\nproperty list uchar int vertex_indices\n";
  EXPECT_THAT(read_error("solid cube\n"), HasSubstr("not a PLY file"));
  EXPECT_THAT(read_error(std::string(100000, 'a')), HasSubstr("not a PLY file"));
  EXPECT_THAT(read_error("ply\nformat binary_big_endian 1.0\nend_header\n"), HasSubstr("line 2: expected format"));
  EXPECT_THAT(read_error("ply\nelement vertex 0\nend_header\n"), HasSubstr("format line"));
  EXPECT_THAT(read_error(ascii + "property float x\nend_header\n"), HasSubstr("line 3: expected an element"));
  EXPECT_THAT(read_error(ascii + "element vertex -1\nend_header\n"), HasSubstr("line 3: expected element NAME COUNT"));
  EXPECT_THAT(read_error(ascii + "element vertex 1\nproperty half x\nend_header\n"), HasSubstr("line 4: unknown type"));
  EXPECT_THAT(read_error(ascii + "end_header\n"), HasSubstr("x, y and z"));
  EXPECT_THAT(read_error(ascii + v + "end_header\n1 nan 0\n"), HasSubstr("vertex 0: expected a finite float32 y"));
  EXPECT_THAT(read_error(ascii + v + "end_header\n1e300 0 0\n"), HasSubstr("vertex 0: expected a finite float32 x"));
  EXPECT_THAT(read_error(ascii + v + "property int id\nend_header\n0 0 0 -4\n"),
              HasSubstr("vertex 0: expected a whole id"));
  EXPECT_THAT(read_error(ascii + v + "end_header\n1 two 0\n"), HasSubstr("expected a number"));
  EXPECT_THAT(read_error(ascii + v + face + "end_header\n0 0 0\n4 0 0 0 0\n"),
              HasSubstr("face 0: expected a triangle"));
  EXPECT_THAT(read_error(ascii + v + face + "end_header\n0 0 0\n3 0 0 1\n"), HasSubstr("index 1 out of range"));
  EXPECT_THAT(read_error(ascii + v + face + "end_header\n0 0 0\n3 0 0 -1\n"), HasSubstr("face 0: vertex index -1"));
  EXPECT_THAT(read_error(ascii + v + "element face 1\nproperty int a\nend_header\n0 0 0\n1\n"),
              HasSubstr("vertex_indices"));
  EXPECT_THAT(read_error("ply\nformat ascii 1.0\ncomment next_id 5\n" + v + "property int id\nend_header\n0 0 0 5\n"),
              HasSubstr("below the header's next_id 5, found 5"));
  // A count that no disk could hold must not be allocated.
  EXPECT_THAT(
      read_error("ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n"
                 "property float z\nend_header\n0000"),
      HasSubstr("truncated"));
}

TEST(Ply, MissingFileAndFolder) {
  EXPECT_THROW(read_ply("/nowhere/a.ply"), InputError);
  EXPECT_THROW(read_ply(fs::temp_directory_path()), InputError);
}

TEST(Ply, UnwritablePlacesAreOneClearLine) {
  const Folder folder;
  const auto write_to = [](const fs::path& path) { return [path] { write_ply(path, tetrahedron(), {}); }; };
  EXPECT_THAT(write_error(write_to("/nowhere/a.ply")), HasSubstr("cannot write /nowhere/a.ply: No such file"));
  EXPECT_THAT(write_error(write_to("/proc/a.ply")), HasSubstr("cannot write /proc/a.ply: "));
  std::ofstream(folder / "file") << "x";
  EXPECT_THAT(write_error(write_to((folder / "file") / "a.ply")), HasSubstr("Not a directory"));
  fs::create_directories(folder / "taken.ply");
  EXPECT_THAT(write_error(write_to(folder / "taken.ply")), HasSubstr("taken.ply: Is a directory"));
  EXPECT_EQ(folder.files(), 2u);
  if (::geteuid() == 0) return;  // root writes where it likes
  fs::permissions(folder.path(), fs::perms::owner_read | fs::perms::owner_exec);
  EXPECT_THAT(write_error(write_to(folder / "a.ply")), HasSubstr("Permission denied"));
  fs::permissions(folder.path(), fs::perms::owner_all);
}

TEST(Ply, FullDiskLeavesTheOldFileWhole) {
  const Folder folder;
  const fs::path path = folder / "a.ply";
  write_ply(path, tetrahedron(), {});
  const std::string before = slurp(path);

  rlimit old{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{20000, old.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const std::string error = write_error([&] { write_ply(path, icosphere(4), {}); });
  ::setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, handler);

  EXPECT_THAT(error, HasSubstr("cannot write " + path.string() + ": File too large"));
  EXPECT_EQ(slurp(path), before);
  EXPECT_EQ(folder.files(), 1u);
}

TEST(Ply, LeftoversOfAKilledRunAreNoObstacle) {
  const Folder folder;
  for (int i = 0; i < 200; ++i)
    std::ofstream(folder / fmt::format(".isoskin-{}-{}.tmp", ::getpid(), i).c_str()) << "old";
  write_file_atomically(folder / "a.bin", std::vector<char>{'o', 'k'});
  EXPECT_EQ(slurp(folder / "a.bin"), "ok");
  EXPECT_EQ(folder.files(), 201u);
}

TEST(Ply, RelativePathWithoutFolder) {
  const Folder folder;
  const fs::path old = fs::current_path();
  fs::current_path(folder.path());
  write_file_atomically("plain.bin", std::vector<char>{'o', 'k'});
  fs::current_path(old);
  EXPECT_EQ(slurp(folder / "plain.bin"), "ok");
}

#include "core/io/frame_files.h"

#include <fmt/format.h>
#include <glob.h>

#include <algorithm>
#include <cctype>
#include <vector>

#include "core/types.h"

namespace isoskin {
namespace {

namespace fs = std::filesystem;

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

// Frame numbers of more digits are not numbers of frames.
constexpr std::size_t kMostDigits = 9;

struct Pattern {  // prefix %0<width>d suffix
  std::string prefix, suffix;
  std::size_t width = 0;
};

Pattern parse_pattern(const std::string& input, const std::string& file_name) {
  const auto malformed = [&] {
    return InputError(fmt::format("{}: expected one frame number like %04d or %d in the file name", input));
  };
  const std::size_t percent = file_name.find('%');
  if (percent == std::string::npos) throw malformed();
  std::size_t at = percent + 1;
  Pattern pattern{file_name.substr(0, percent), {}, 1};
  if (at < file_name.size() && file_name[at] == '0') {
    const std::size_t digits = ++at;
    while (at < file_name.size() && is_digit(file_name[at])) ++at;
    if (at == digits || at - digits > 2) throw malformed();
    pattern.width = std::stoul(file_name.substr(digits, at - digits));
  }
  if (at >= file_name.size() || file_name[at] != 'd') throw malformed();
  pattern.suffix = file_name.substr(at + 1);
  if (pattern.suffix.find('%') != std::string::npos) throw malformed();
  return pattern;
}

// The frame whose name by the pattern is `name`, or -1.
int match(const Pattern& pattern, const std::string& name) {
  const std::size_t ends = pattern.prefix.size() + pattern.suffix.size();
  if (name.size() <= ends || !name.starts_with(pattern.prefix) || !name.ends_with(pattern.suffix)) return -1;
  const std::string digits = name.substr(pattern.prefix.size(), name.size() - ends);
  const bool padded = digits.size() == pattern.width || (digits.size() > pattern.width && digits[0] != '0');
  if (!padded || digits.size() > kMostDigits || !std::all_of(digits.begin(), digits.end(), is_digit)) return -1;
  return std::stoi(digits);
}

std::vector<fs::path> files_in(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (!at->is_directory()) files.push_back(at->path());
  }
  if (error) throw InputError(fmt::format("{}: cannot read the folder: {}", folder.string(), error.message()));
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<fs::path> files_of_glob(const std::string& input) {
  glob_t found{};
  std::vector<fs::path> files;
  if (::glob(input.c_str(), 0, nullptr, &found) == 0) files.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  ::globfree(&found);
  return files;  // sorted by glob()
}

std::string trimmed(std::string stem) {
  while (!stem.empty() && std::string("._-").find(stem.back()) != std::string::npos) stem.pop_back();
  return stem;
}

std::string name_or_folder(const std::string& name, const fs::path& file) {
  if (!name.empty()) return name;
  const std::string folder = fs::absolute(file).parent_path().filename().string();
  return folder.empty() ? "frame" : folder;
}

FrameFiles by_pattern(const std::string& input) {
  const fs::path path(input);
  const Pattern pattern = parse_pattern(input, path.filename().string());
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  if (!fs::is_directory(folder)) throw InputError(fmt::format("{}: there is no folder {}", input, folder.string()));
  FrameFiles frames{name_or_folder(trimmed(pattern.prefix), path), {}};
  for (const fs::path& file : files_in(folder)) {
    const int frame = match(pattern, file.filename().string());
    if (frame >= 0) frames.file[frame] = path.has_parent_path() ? file : file.filename();
  }
  if (frames.file.empty()) throw InputError(fmt::format("{}: no file matches the pattern", input));
  return frames;
}

// All files must belong to one sequence.
FrameFiles by_list(const std::string& input, const std::vector<fs::path>& files) {
  if (files.empty()) throw InputError(fmt::format("{}: no such file", input));
  FrameFiles frames;
  for (const fs::path& file : files) {
    std::string stem;
    int frame = frame_number(file, &stem);
    if (frame < 0 && files.size() > 1) {
      throw InputError(fmt::format("{}: {} has no frame number", input, file.filename().string()));
    }
    if (frame < 0) frame = 1;
    if (frames.file.empty()) frames.name = stem;
    if (stem != frames.name) {
      throw InputError(fmt::format("{}: holds several sequences ({} and {}); name one by a pattern like {}.%04d.vdb",
                                   input, frames.name, stem, frames.name));
    }
    const auto [at, fresh] = frames.file.try_emplace(frame, file);
    if (!fresh) {
      throw InputError(fmt::format("{}: two files for frame {}: {} and {}", input, frame,
                                   at->second.filename().string(), file.filename().string()));
    }
  }
  frames.name = name_or_folder(frames.name, files.front());
  return frames;
}

}  // namespace

int frame_number(const fs::path& file, std::string* stem) {
  const std::string whole = file.stem().string();
  std::size_t digits = whole.size();
  while (digits > 0 && is_digit(whole[digits - 1])) --digits;
  const bool numbered = digits < whole.size() && whole.size() - digits <= kMostDigits;
  if (stem) *stem = numbered ? trimmed(whole.substr(0, digits)) : whole;
  return numbered ? std::stoi(whole.substr(digits)) : -1;
}

FrameFiles find_frames(const std::string& input, const std::string& extension) {
  if (fs::is_directory(input)) {
    std::vector<fs::path> files = files_in(input);
    std::erase_if(files, [&](const fs::path& file) { return file.extension() != extension; });
    if (files.empty()) throw InputError(fmt::format("{}: no {} files in this folder", input, extension));
    return by_list(input, files);
  }
  if (fs::exists(input)) return by_list(input, {input});
  if (input.find('%') != std::string::npos) return by_pattern(input);
  if (input.find_first_of("*?[") != std::string::npos) {
    const std::vector<fs::path> files = files_of_glob(input);
    if (files.empty()) throw InputError(fmt::format("{}: no file matches the glob", input));
    return by_list(input, files);
  }
  throw InputError(fmt::format("{}: no such file", input));
}

}  // namespace isoskin

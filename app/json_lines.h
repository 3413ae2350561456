// Files of one JSON object a line that survive being killed at any moment.
#pragma once

#include <filesystem>
#include <vector>

#include "app/report.h"

namespace isoskin {

/// The whole lines at the start of a file, up to the first that is cut short or is no JSON object. Empty when there is
/// no file.
std::vector<Json> read_json_lines(const std::filesystem::path& path);

/// Appends lines; each is on disk, whole, when append() returns.
class JsonLines {
public:
  /// Opens for appending, creates when absent. Throws InputError when it cannot.
  explicit JsonLines(std::filesystem::path path);
  ~JsonLines();
  JsonLines(const JsonLines&) = delete;
  JsonLines& operator=(const JsonLines&) = delete;

  /// Throws InputError when the disk is full; the file is then as it was.
  void append(const std::vector<Json>& lines);

private:
  std::filesystem::path path_;
  int file_ = -1;
};

}  // namespace isoskin

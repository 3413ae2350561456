#include "app/json_lines.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstring>
#include <fstream>

#include <fmt/format.h>

namespace isoskin {

std::vector<Json> read_json_lines(const std::filesystem::path& path) {
  std::vector<Json> lines;
  std::ifstream file(path);
  std::string text;
  while (std::getline(file, text) && !file.eof()) {  // at the end of file the line lacks its newline: cut short
    Json line = Json::parse(text, nullptr, false);
    if (!line.is_object()) break;
    lines.push_back(std::move(line));
  }
  return lines;
}

JsonLines::JsonLines(std::filesystem::path path) : path_(std::move(path)) {
  file_ = open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
  if (file_ < 0)
    throw InputError(fmt::format("{}: {}; expected a writable file", path_.string(), std::strerror(errno)));
}

JsonLines::~JsonLines() {
  close(file_);
}

void JsonLines::append(const std::vector<Json>& lines) {
  std::string text;
  for (const Json& line : lines) text += line.dump() + '\n';
  const off_t before = lseek(file_, 0, SEEK_END);
  const ssize_t written = write(file_, text.data(), text.size());
  if (written == ssize_t(text.size()) && fdatasync(file_) == 0) return;
  const std::string reason = written < 0 ? std::strerror(errno) : "no space left";
  if (ftruncate(file_, before) != 0) throw InputError(fmt::format("{}: {}", path_.string(), std::strerror(errno)));
  throw InputError(fmt::format("{}: {}; expected room for a line", path_.string(), reason));
}

}  // namespace isoskin

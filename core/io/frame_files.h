// Numbered files on disk: printf patterns, folders, globs (design 9, 10).
#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace isoskin {

/// The files of a sequence by frame number, and its name: the file stem without number ("dam_break").
struct FrameFiles {
  std::string name;
  std::map<int, std::filesystem::path> file;
};

/// The number at the end of the file's stem, or -1; `stem` receives what is before it, without trailing . _ -
int frame_number(const std::filesystem::path& file, std::string* stem = nullptr);

/// `input`: a printf pattern with one %d or %0Nd in the file name, a folder (its files ending in `extension`), a glob,
/// or one file, which need not be numbered (then it is frame 1). Throws InputError: nothing there, several sequences at
/// once, two files for one frame, a malformed pattern.
FrameFiles find_frames(const std::string& input, const std::string& extension);

}  // namespace isoskin

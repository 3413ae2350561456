// Runs the built program as its users do: arguments in, exit status and what it printed out.
#pragma once

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/temporary_folder.h"

namespace isoskin::test {

namespace fs = std::filesystem;

inline std::string read_text(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

inline void write_text(const fs::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

struct Surroundings {
  std::vector<std::pair<std::string, std::string>> environment;
  std::optional<std::size_t> largest_file;  // bytes; a full disk, as far as the program can tell
  std::string output;                       // where standard output goes; empty: into Ran::out
};

/// A program that has been started; pipes would block when nobody reads them, so it prints to files.
class Running {
public:
  explicit Running(const std::vector<std::string>& arguments, const Surroundings& around = {})
      : out_(around.output.empty() ? (folder_ / "out").string() : around.output) {
    std::vector<char*> argv{const_cast<char*>(ISOSKIN_PROGRAM)};
    for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
    argv.push_back(nullptr);
    // Standard error is not under the limit of file size, so that it can be read: it is a pipe's end.
    if (pipe(error_pipe_) != 0) throw std::runtime_error("no pipe");
    pid_ = fork();
    if (pid_ != 0) {
      close(error_pipe_[1]);
      return;
    }
    dup2(open(out_.c_str(), O_WRONLY | O_CREAT, 0600), STDOUT_FILENO);
    dup2(error_pipe_[1], STDERR_FILENO);
    for (const auto& [name, value] : around.environment) setenv(name.c_str(), value.c_str(), 1);
    if (around.largest_file) {
      const rlimit limit{*around.largest_file, *around.largest_file};
      setrlimit(RLIMIT_FSIZE, &limit);
    }
    execv(argv[0], argv.data());
    _exit(127);
  }
  ~Running() {
    if (!waited_) {
      signal(SIGKILL);
      wait();
    }
    close(error_pipe_[0]);
  }
  Running(const Running&) = delete;
  Running& operator=(const Running&) = delete;

  void signal(int number) const { kill(pid_, number); }

  bool has_ended() {
    waited_ = waited_ || waitpid(pid_, &status_, WNOHANG) == pid_;
    return waited_;
  }

  /// Exit status, or minus the signal that ended it.
  int wait() {
    char buffer[4096];
    for (ssize_t n; (n = read(error_pipe_[0], buffer, sizeof buffer)) > 0;) err_.append(buffer, std::size_t(n));
    if (!waited_) waitpid(pid_, &status_, 0);
    waited_ = true;
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : -WTERMSIG(status_);
  }
  std::string out() const { return out_.starts_with("/dev/") ? "" : read_text(out_); }
  const std::string& err() const { return err_; }  // after wait()

private:
  TemporaryFolder folder_;
  std::string out_, err_;
  int error_pipe_[2] = {-1, -1};
  pid_t pid_ = -1;
  int status_ = 0;
  bool waited_ = false;
};

struct Ran {
  int status = 0;
  std::string out, err;
};

inline Ran run_program(const std::vector<std::string>& arguments, const Surroundings& around = {}) {
  Running running(arguments, around);
  const int status = running.wait();
  return {status, running.out(), running.err()};
}

/// Two balls that pass through one another: a merge and a split within ten frames, a few hundred triangles.
inline void write_small_scene(const fs::path& path) {
  write_text(path, R"(name = "balls"
frames = [1, 10]
dt = 0.1
iso = 0.3
[[element]]
kind = "point"
potential = "metaball"
radius = 1.0
keys = [ { frame = 1, position = [-1.1, 0.0, 0.0] }, { frame = 10, position = [1.1, 0.1, 0.0] } ]
[[element]]
kind = "point"
potential = "metaball"
radius = 0.9
keys = [ { frame = 1, position = [1.1, 0.0, 0.0] }, { frame = 10, position = [-1.1, 0.0, 0.1] } ]
)");
}

/// Arguments that track that scene in a fraction of a second.
inline std::vector<std::string> track_small(const fs::path& scene, const fs::path& folder,
                                            const std::vector<std::string>& more = {}) {
  std::vector<std::string> arguments{"track", scene.string(),    "-o",   folder.string(), "--edge-length",
                                     "0.15",  "--interpolation", "cubic"};
  if (std::find(more.begin(), more.end(), "--backend") == more.end())
    arguments.insert(arguments.end(), {"--backend", "reference"});
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

}  // namespace isoskin::test

#pragma once
// Writing results without ever leaving half a file or destroying what is not ours.
//
// WARNING: a program that writes with this calls ignore_file_signals() first. Otherwise a file size limit
// (SIGXFSZ) or a reader that went away (SIGPIPE) kills it before the error can be reported.

#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace kfstab::reports {

/// what() says what was tried, where and why it failed: "cannot write out/a.csv: No space left on device".
class FileError : public std::runtime_error {
 public:
  FileError(std::string_view action, const std::filesystem::path& path, std::string_view reason);
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Turns SIGXFSZ and SIGPIPE into ordinary errors of the call that writes, for the whole process.
void ignore_file_signals();

/// A file that is written piece by piece, under a temporary name beside `path`. commit() flushes it to the disk and renames
/// it to `path`; without it the temporary is removed, and what stood at `path` stands. What goes wrong is thrown as
/// FileError. A `path` that is not a regular file (/dev/stdout, a pipe) is written directly.
class PendingFile {
 public:
  explicit PendingFile(std::filesystem::path path);
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;
  ~PendingFile();

  void write(std::string_view content);
  void commit();

 private:
  [[noreturn]] void fail(int error);

  std::filesystem::path path_, target_, temporary_;  // no temporary: written directly
  int descriptor_ = -1;
  std::string buffer_;
};

/// Writes `content` under a temporary name beside `path`, flushes it to the disk, then renames it to `path`.
/// If anything fails the temporary is removed, what stood at `path` stands, and FileError is thrown.
/// A `path` that is not a regular file (/dev/stdout, a pipe) is written directly.
void write_file(const std::filesystem::path& path, std::string_view content);

/// The folder of one run's results. A marker, `.kfstab`, says that it is ours and lists what we wrote, so that a
/// later run into it replaces our files, and only ours.
class Folder {
 public:
  static constexpr std::string_view marker = ".kfstab";

  /// Creates the folder with its parents, or takes over one of ours and removes the files an earlier run wrote.
  /// Throws FileError for a non-empty folder without the marker, and for whatever cannot be created.
  explicit Folder(std::filesystem::path path);

  const std::filesystem::path& path() const { return path_; }

  /// As write_file. `name` is a plain file name: no folders in it.
  void write(std::string_view name, std::string_view content) const;

  /// Enters in the marker, at once, names that will be written by whatever program, and removes what stands there.
  void announce(const std::vector<std::string>& names) const;

 private:
  void enter(const std::vector<std::string>& names) const;

  std::filesystem::path path_;
};

}  // namespace kfstab::reports

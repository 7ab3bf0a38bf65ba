#include <kfstab/reports/files.hpp>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <fstream>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <tuple>
#include <utility>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fmt/format.h>

namespace kfstab::reports {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view marker_title = "Results of kfstab. The next run into this folder replaces the files listed below, no others.";

std::string reason_of(int error) { return std::generic_category().message(error); }

/// Returns 0, or the error.
int write_all(int descriptor, std::string_view content) {
  while (!content.empty()) {
    const ssize_t written = ::write(descriptor, content.data(), content.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return errno;
    if (written == 0) return EIO;
    content.remove_prefix(static_cast<std::size_t>(written));
  }
  return 0;
}

/// A name beside `path` that nobody has, opened; the mode is the user's umask's, as for any new file.
std::pair<fs::path, int> open_temporary(const fs::path& path) {
  static std::atomic<unsigned> counter = 0;
  for (;;) {
    fs::path temporary = path.parent_path() / fmt::format(".kfstab-{}-{}", ::getpid(), counter++);
    const int descriptor = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (descriptor >= 0 || errno != EEXIST) return {std::move(temporary), descriptor};
  }
}

bool is_plain_name(std::string_view name) {
  return !name.empty() && name != "." && name != ".." && name.find_first_of(std::string_view("/\n\0", 3)) == name.npos;
}

/// The names in the marker; nothing if the file is not our marker.
std::optional<std::set<std::string>> read_marker(const fs::path& marker) {
  std::ifstream file(marker);
  std::string line;
  if (!std::getline(file, line) || line != marker_title) return std::nullopt;
  std::set<std::string> names;
  while (std::getline(file, line))
    if (is_plain_name(line)) names.insert(line);
  return names;
}

void write_marker(const fs::path& marker, const std::set<std::string>& names) {
  write_file(marker, fmt::format("{}\n{}{}", marker_title, fmt::join(names, "\n"), names.empty() ? "" : "\n"));
}

void remove_if_there(const fs::path& path) {
  if (::unlink(path.c_str()) != 0 && errno != ENOENT) throw FileError("replace", path, reason_of(errno));
}

}  // namespace

FileError::FileError(std::string_view action, const fs::path& path, std::string_view reason)
    : std::runtime_error(fmt::format("cannot {} {}: {}", action, path.string(), reason)), path_(path) {}

void ignore_file_signals() {
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
}

PendingFile::PendingFile(fs::path path) : path_(std::move(path)) {
  std::error_code unknown;
  const fs::file_status status = fs::status(path_, unknown);
  if (fs::is_directory(status)) throw FileError("write", path_, "it is a folder");
  const bool in_dev = path_.string().starts_with("/dev/");  // /dev/stdout may lead to a regular file
  if (fs::exists(status) && (in_dev || !fs::is_regular_file(status))) {
    descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CLOEXEC);
  } else {
    // Through a symbolic link, so that the link stays.
    target_ = fs::is_symlink(fs::symlink_status(path_, unknown)) ? fs::weakly_canonical(path_, unknown) : path_;
    std::tie(temporary_, descriptor_) = open_temporary(target_);
  }
  if (descriptor_ < 0) throw FileError("write", path_, reason_of(errno));
}

PendingFile::~PendingFile() {
  if (descriptor_ < 0) return;
  ::close(descriptor_);
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

void PendingFile::write(std::string_view content) {
  constexpr std::size_t piece = std::size_t{1} << 16;
  buffer_ += content;
  if (buffer_.size() < piece) return;
  if (const int error = write_all(descriptor_, buffer_)) fail(error);
  buffer_.clear();
}

void PendingFile::commit() {
  int error = write_all(descriptor_, buffer_);
  if (error == 0 && !temporary_.empty() && ::fsync(descriptor_) != 0) error = errno;
  // Some file systems tell of a full disk only here.
  if (::close(std::exchange(descriptor_, -1)) != 0 && error == 0) error = errno;
  if (error == 0 && !temporary_.empty() && ::rename(temporary_.c_str(), target_.c_str()) != 0) error = errno;
  if (error != 0) fail(error);
}

void PendingFile::fail(int error) {
  if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
  throw FileError("write", path_, reason_of(error));
}

void write_file(const fs::path& path, std::string_view content) {
  PendingFile file(path);
  file.write(content);
  file.commit();
}

Folder::Folder(fs::path path) : path_(std::move(path)) {
  std::error_code error;
  fs::create_directories(path_, error);
  if (!fs::is_directory(path_, error)) {
    // create_directories does not say which of the parents is in the way; mkdir does not either, but knows why.
    const int reason = ::mkdir(path_.c_str(), 0777) != 0 ? errno : 0;
    throw FileError("create folder", path_, reason == EEXIST ? "a file of that name is in the way" : reason_of(reason));
  }

  const fs::path marker_path = path_ / marker;
  if (const auto ours = read_marker(marker_path)) {
    for (const std::string& name : *ours) remove_if_there(path_ / name);
  } else {
    const bool empty = fs::is_empty(path_, error);
    if (error) throw FileError("read folder", path_, error.message());
    if (!empty)
      throw FileError("use folder", path_, fmt::format("it is not empty and holds no {} of ours; name another, or empty it", marker));
  }
  write_marker(marker_path, {});
}

void Folder::write(std::string_view name, std::string_view content) const {
  enter({std::string(name)});
  write_file(path_ / name, content);
}

void Folder::announce(const std::vector<std::string>& names) const {
  enter(names);
  for (const std::string& name : names) remove_if_there(path_ / name);
}

// Entered before it is written: a run that is killed leaves no file of ours that the marker does not know.
void Folder::enter(const std::vector<std::string>& names) const {
  const fs::path marker_path = path_ / marker;
  for (const std::string& name : names)
    if (!is_plain_name(name) || name == marker)
      throw FileError("write", path_ / name, "a plain file name was expected");
  auto known = read_marker(marker_path);
  if (!known) throw FileError("write", path_ / names.front(), fmt::format("the folder's {} is gone", marker));
  const std::size_t before = known->size();
  known->insert(names.begin(), names.end());
  if (known->size() != before) write_marker(marker_path, *known);
}

}  // namespace kfstab::reports

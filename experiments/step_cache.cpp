#include <kfstab/experiments/step_cache.hpp>

#include <fstream>
#include <system_error>

#include <fmt/format.h>

namespace kfstab::experiments {
namespace {

namespace fs = std::filesystem;

std::string title(const std::string& key) { return "kfstab.reference-cache/1 " + key; }

std::string end(std::int64_t lines, const std::string& checksum) {
  return fmt::format("end of {} lines, {}", lines, checksum);
}

/// How many lines the file holds after its title; nothing unless its last line says that it is whole.
std::optional<std::int64_t> whole(std::istream& file, const std::string& key) {
  std::string line, next;
  if (!std::getline(file, line) || line != title(key) || !std::getline(file, line)) return std::nullopt;
  Checksum checksum;
  checksum.add(title(key));
  std::int64_t lines = 0;
  // A line is the last one if there is none behind it.
  for (; std::getline(file, next); line.swap(next), ++lines) checksum.add(line);
  if (line != end(lines, checksum.hex())) return std::nullopt;
  return lines;
}

}  // namespace

void Checksum::add(std::string_view text) {
  const std::string length = fmt::format("{}:", text.size());
  sha1_.process_bytes(length.data(), length.size());
  sha1_.process_bytes(text.data(), text.size());
}

std::string Checksum::hex() {
  boost::uuids::detail::sha1::digest_type digest;
  sha1_.get_digest(digest);
  std::string text;
  for (const unsigned word : digest) text += fmt::format("{:08x}", word);
  return text;
}

StepCache::StepCache(fs::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (!fs::is_directory(folder_))
    throw reports::FileError("create folder", folder_, error ? error.message() : "a file of that name is in the way");
}

fs::path StepCache::path(const std::string& key) const { return folder_ / (key + ".steps"); }

bool StepCache::replay(const std::string& key, const std::function<bool(std::string_view)>& take) const {
  std::ifstream file(path(key), std::ios::binary);
  const auto lines = whole(file, key);
  if (!lines) return false;
  file.clear();
  file.seekg(0);
  std::string line;
  std::getline(file, line);
  for (std::int64_t i = 0; i < *lines && std::getline(file, line); ++i)
    if (!take(line)) break;
  return true;
}

StepCache::Entry::Entry(const StepCache& cache, const std::string& key) : file_(cache.path(key)) { write(title(key)); }

void StepCache::Entry::add(std::string_view line) {
  write(line);
  ++lines_;
}

void StepCache::Entry::write(std::string_view line) {
  checksum_.add(line);
  file_.write(line);
  file_.write("\n");
}

void StepCache::Entry::commit() {
  file_.write(end(lines_, checksum_.hex()) + "\n");
  file_.commit();
}

}  // namespace kfstab::experiments

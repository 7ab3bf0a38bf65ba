#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include <boost/uuid/detail/sha1.hpp>

#include <kfstab/reports/files.hpp>

/// The cache of `kfstab reference`: finished trajectories on disk, a file each, named by what they are of.
namespace kfstab::experiments {

/// SHA-1 of a list of texts. Each goes in with its length, so that no two lists run into one.
class Checksum {
 public:
  void add(std::string_view text);
  /// 40 hexadecimal digits; nothing can be added any more.
  std::string hex();

 private:
  boost::uuids::detail::sha1 sha1_;
};

/// Any number of processes may use one folder at once: each writes under a name of its own and renames what it has
/// finished, and who reads a file keeps it open. A file says in its last line what the lines before it come to, so that
/// one that is torn or was changed is no hit, and is replaced.
class StepCache {
 public:
  /// Creates the folder. Throws reports::FileError if it cannot be.
  explicit StepCache(std::filesystem::path folder);

  /// Calls take for each line of the file of that key, until it returns false. False, and take not called, if there is no
  /// such file or it is not whole.
  bool replay(const std::string& key, const std::function<bool(std::string_view)>& take) const;

  /// Lines on their way into a file, which is there once they are committed.
  class Entry {
   public:
    Entry(const StepCache& cache, const std::string& key);
    void add(std::string_view line);
    void commit();

   private:
    void write(std::string_view line);

    reports::PendingFile file_;
    Checksum checksum_;
    std::int64_t lines_ = 0;
  };

 private:
  std::filesystem::path path(const std::string& key) const;

  std::filesystem::path folder_;
};

}  // namespace kfstab::experiments

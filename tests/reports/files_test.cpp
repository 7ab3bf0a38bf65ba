#include <kfstab/reports/files.hpp>

#include <csignal>

#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "reports/scratch.hpp"

using namespace kfstab::reports;
namespace fs = std::filesystem;

namespace {

class Files : public ScratchFolder {};

/// The message of the FileError that the action throws.
template <class Action>
std::string error_of(Action action) {
  try {
    action();
  } catch (const FileError& error) {
    return error.what();
  }
  return "no error";
}

/// No file may become larger than this, for as long as this lives.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    ::getrlimit(RLIMIT_FSIZE, &old_);
    const rlimit limit{bytes, old_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;
  ~FileSizeLimit() { ::setrlimit(RLIMIT_FSIZE, &old_); }

 private:
  rlimit old_{};
};

}  // namespace

TEST_F(Files, WritesAndReplacesWithoutATrace) {
  write_file(folder / "a", "one");
  EXPECT_EQ(read(folder / "a"), "one");
  const std::string binary("two\0\n", 5);
  write_file(folder / "a", binary);
  EXPECT_EQ(read(folder / "a"), binary);
  EXPECT_EQ(entries(folder), 1u);
}

TEST_F(Files, APendingFileIsThereOnceItIsCommitted) {
  put(folder / "a", "old");
  {
    PendingFile file(folder / "a");
    file.write("lost");
    EXPECT_EQ(read(folder / "a"), "old");
  }
  EXPECT_EQ(read(folder / "a"), "old");
  EXPECT_EQ(entries(folder), 1u) << "no temporary is left";
  PendingFile file(folder / "a");
  std::string all;
  for (int i = 0; i < 100000; ++i) {  // many times what is held back
    const std::string piece = std::to_string(i) + "\n";
    file.write(piece);
    all += piece;
  }
  EXPECT_EQ(read(folder / "a"), "old");
  file.commit();
  EXPECT_EQ(read(folder / "a"), all);
  EXPECT_EQ(entries(folder), 1u);
}

TEST_F(Files, APendingFileThatCannotBeWrittenLeavesNothing) {
  put(folder / "a", "old");
  const FileSizeLimit limit(100000);
  ignore_file_signals();
  PendingFile file(folder / "a");
  const std::string piece(60000, 'x');
  EXPECT_NE(error_of([&] {
              for (int i = 0; i < 4; ++i) file.write(piece);
            }).find("cannot write " + (folder / "a").string()),
            std::string::npos);
  EXPECT_EQ(read(folder / "a"), "old");
  EXPECT_EQ(entries(folder), 1u);
}

TEST_F(Files, NewFilesHaveTheUsersMode) {
  const mode_t old = ::umask(027);
  write_file(folder / "a", "one");
  ::umask(old);
  struct stat status {};
  ASSERT_EQ(::stat((folder / "a").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0640u);
}

TEST_F(Files, WritesThroughALink) {
  write_file(folder / "a", "one");
  fs::create_symlink("a", folder / "link");
  write_file(folder / "link", "two");
  EXPECT_TRUE(fs::is_symlink(folder / "link"));
  EXPECT_EQ(read(folder / "a"), "two");
}

TEST_F(Files, AnErrorSaysWhatWhereAndWhy) {
  put(folder / "file", "");
  EXPECT_EQ(error_of([&] { write_file(folder / "file" / "a", "x"); }),
            "cannot write " + (folder / "file" / "a").string() + ": Not a directory");
  EXPECT_EQ(error_of([&] { write_file(folder / "none" / "a", "x"); }),
            "cannot write " + (folder / "none" / "a").string() + ": No such file or directory");
  EXPECT_NE(error_of([&] { write_file(folder, "x"); }).find("it is a folder"), std::string::npos);
  EXPECT_EQ(error_of([] { write_file("/dev/full", "x"); }), "cannot write /dev/full: No space left on device");
  EXPECT_NO_THROW(write_file("/dev/null", "x"));
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST_F(Files, WhatDoesNotFitLeavesTheOldFileAndNoTemporary) {
  ignore_file_signals();
  write_file(folder / "a", "old");
  {
    const FileSizeLimit limit(1000);
    EXPECT_EQ(error_of([&] { write_file(folder / "a", std::string(5000, 'x')); }), "cannot write " + (folder / "a").string() + ": File too large");
  }
  EXPECT_EQ(read(folder / "a"), "old");
  EXPECT_EQ(entries(folder), 1u);
}

TEST_F(Files, AReaderThatWentAwayIsAnErrorNotADeath) {
  ignore_file_signals();
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  ::close(ends[0]);
  EXPECT_NE(error_of([&] { write_file("/dev/fd/" + std::to_string(ends[1]), "x"); }), "no error");
  ::close(ends[1]);
}

TEST_F(Files, AFolderIsMadeWithItsParents) {
  const Folder made(folder / "a" / "b" / "");
  made.write("x.csv", "1\n");
  EXPECT_EQ(read(folder / "a" / "b" / "x.csv"), "1\n");
}

TEST_F(Files, AnEmptyFolderIsTaken) {
  fs::create_directory(folder / "a");
  EXPECT_NO_THROW(Folder(folder / "a").write("x", ""));
}

TEST_F(Files, AForeignFolderIsRefusedUntouched) {
  put(folder / "thesis.tex", "years of work");
  EXPECT_NE(error_of([&] { const Folder taken(folder); }).find("it is not empty"), std::string::npos);
  EXPECT_EQ(entries(folder), 1u);
  // A file of the marker's name is not yet our marker.
  put(folder / ".kfstab", "thesis.tex\n");
  EXPECT_NE(error_of([&] { const Folder taken(folder); }), "no error");
  EXPECT_EQ(read(folder / "thesis.tex"), "years of work");
}

TEST_F(Files, AFolderOfOursLosesOurFilesAndNoOthers) {
  const fs::path path = folder / "run";
  {
    const Folder first(path);
    first.write("old.csv", "old");
    first.write("old.csv", "old again");
    first.announce({"old.svg", "old.png"});
    put(path / "old.svg", "picture");
  }
  put(path / "notes.txt", "mine");
  const Folder second(path);
  second.write("new.csv", "new");
  EXPECT_FALSE(fs::exists(path / "old.csv"));
  EXPECT_FALSE(fs::exists(path / "old.svg"));
  EXPECT_EQ(read(path / "notes.txt"), "mine");
  EXPECT_EQ(read(path / "new.csv"), "new");
  EXPECT_EQ(entries(path), 3u);
}

TEST_F(Files, AMarkerCannotPointOutOfItsFolder) {
  put(folder / "victim", "alive");
  const fs::path path = folder / "run";
  { const Folder ours(path); }
  put(path / ".kfstab", read(path / ".kfstab") + "../victim\n");
  { const Folder ours(path); }
  EXPECT_EQ(read(folder / "victim"), "alive");
  const Folder ours(path);
  for (const char* name : {"../victim", "", ".", "..", "a/b", ".kfstab", "a\nb"}) EXPECT_THROW(ours.write(name, "x"), FileError) << name;
  EXPECT_EQ(read(folder / "victim"), "alive");
}

TEST_F(Files, AFolderThatCannotBeIsAnError) {
  put(folder / "file", "");
  EXPECT_NE(error_of([&] { const Folder made(folder / "file"); }).find("a file of that name is in the way"), std::string::npos);
  EXPECT_NE(error_of([&] { const Folder made(folder / "file" / "a"); }).find("Not a directory"), std::string::npos);
  EXPECT_NE(error_of([&] { const Folder made("/proc/kfstab"); }), "no error");
}

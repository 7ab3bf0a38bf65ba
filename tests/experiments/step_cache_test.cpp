#include <kfstab/experiments/step_cache.hpp>

#include "reports/scratch.hpp"

namespace kfstab::experiments {
namespace {

class CacheOfSteps : public ScratchFolder {
 protected:
  void SetUp() override {
    ScratchFolder::SetUp();
    file = folder / "cache" / "key.steps";
  }
  static void fill(const StepCache& cache, const std::vector<std::string>& lines) {
    StepCache::Entry entry(cache, "key");
    for (const std::string& line : lines) entry.add(line);
    entry.commit();
  }
  /// Nothing for no hit.
  static std::optional<std::vector<std::string>> lines(const StepCache& cache, const std::string& key = "key") {
    std::vector<std::string> taken;
    const bool hit = cache.replay(key, [&](std::string_view line) {
      taken.emplace_back(line);
      return true;
    });
    EXPECT_TRUE(hit || taken.empty());
    return hit ? std::optional(taken) : std::nullopt;
  }

  std::filesystem::path file;
};

const std::vector<std::string> some = {"{\"k\":0}", "", "end of 2 lines, no"};

TEST(Checksum, IsSha1OfTextsAndTheirLengths) {
  Checksum checksum;
  checksum.add("abc");
  EXPECT_EQ(checksum.hex(), "7ac1b65bee717261fd2b947f0cc5ef99c55f3c18");  // printf 3:abc | sha1sum
  const auto of = [](const std::vector<std::string>& texts) {
    Checksum f;
    for (const auto& text : texts) f.add(text);
    return f.hex();
  };
  EXPECT_NE(of({"ab", "c"}), of({"a", "bc"}));
  EXPECT_NE(of({"1:a"}), of({"", "a"}));
  EXPECT_EQ(of({}), Checksum().hex());
}

TEST_F(CacheOfSteps, GivesBackWhatWasCommitted) {
  const StepCache cache(folder / "cache");
  EXPECT_FALSE(lines(cache));
  fill(cache, some);
  EXPECT_EQ(lines(cache), some);
  EXPECT_FALSE(lines(cache, "other"));
  fill(cache, {});
  EXPECT_EQ(lines(cache), std::vector<std::string>{});
  EXPECT_EQ(entries(folder / "cache"), 1u);
}

TEST_F(CacheOfSteps, AnEntryThatIsNotCommittedIsNone) {
  const StepCache cache(folder / "cache");
  fill(cache, some);
  { StepCache::Entry(cache, "key").add("half"); }
  EXPECT_EQ(lines(cache), some);
  EXPECT_EQ(entries(folder / "cache"), 1u);
}

TEST_F(CacheOfSteps, ATornFileIsNoHit) {
  const StepCache cache(folder / "cache");
  fill(cache, some);
  const std::string whole = read(file);
  // The newline at the very end is no part of what is said.
  for (std::size_t size = 0; size + 1 < whole.size(); ++size) {
    put(file, whole.substr(0, size));
    EXPECT_FALSE(lines(cache)) << "cut to " << size << " of " << whole.size();
  }
  put(file, whole);
  EXPECT_TRUE(lines(cache));
}

TEST_F(CacheOfSteps, AChangedFileIsNoHit) {
  const StepCache cache(folder / "cache");
  fill(cache, some);
  const std::string whole = read(file);
  for (std::size_t at = 0; at + 1 < whole.size(); ++at) {
    std::string changed = whole;
    changed[at] = static_cast<char>(changed[at] ^ 1);
    put(file, changed);
    EXPECT_FALSE(lines(cache)) << "at " << at;
  }
  put(file, whole + "more\n");
  EXPECT_FALSE(lines(cache));
  put(file, whole);
  std::filesystem::rename(file, folder / "cache" / "other.steps");
  EXPECT_FALSE(lines(cache, "other")) << "it is of another key";
}

TEST_F(CacheOfSteps, WritersDoNotMeet) {
  const StepCache cache(folder / "cache");
  StepCache::Entry first(cache, "key"), second(cache, "key");
  first.add("1");
  second.add("2");
  second.commit();
  EXPECT_EQ(lines(cache), std::vector<std::string>{"2"});
  first.commit();
  EXPECT_EQ(lines(cache), std::vector<std::string>{"1"});
}

TEST_F(CacheOfSteps, AReaderKeepsWhatItOpened) {
  const StepCache cache(folder / "cache");
  fill(cache, {"1", "2"});
  std::vector<std::string> taken;
  cache.replay("key", [&](std::string_view line) {
    taken.emplace_back(line);
    fill(cache, {"3", "4", "5"});
    return true;
  });
  EXPECT_EQ(taken, (std::vector<std::string>{"1", "2"}));
}

TEST_F(CacheOfSteps, StopsWhenToldTo) {
  const StepCache cache(folder / "cache");
  fill(cache, {"1", "2"});
  int calls = 0;
  EXPECT_TRUE(cache.replay("key", [&](std::string_view) { return ++calls == 0; }));
  EXPECT_EQ(calls, 1);
}

TEST_F(CacheOfSteps, AFolderThatCannotBeIsAnError) {
  put(folder / "file", "");
  EXPECT_THROW(StepCache(folder / "file"), reports::FileError);
  EXPECT_THROW(StepCache(folder / "file" / "below"), reports::FileError);
}

}  // namespace
}  // namespace kfstab::experiments

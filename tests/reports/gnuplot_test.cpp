#include <kfstab/reports/gnuplot.hpp>

#include "reports/scratch.hpp"

using namespace kfstab::reports;
namespace fs = std::filesystem;

namespace {

class GnuplotProgram : public ScratchFolder {
 protected:
  /// A program of that name and text, first in PATH.
  Environment fake(const std::string& text) {
    fs::create_directory(folder / "bin");
    put(folder / "bin" / "gnuplot", "#!/bin/sh\n" + text);
    fs::permissions(folder / "bin" / "gnuplot", fs::perms::owner_all);
    return Environment("PATH", (folder / "bin").string() + ":" + std::getenv("PATH"));
  }
};

}  // namespace

TEST_F(GnuplotProgram, IsLookedForInPath) {
  const Environment none("PATH", folder.string());
  EXPECT_FALSE(find_gnuplot());
  put(folder / "gnuplot", "not executable");
  fs::permissions(folder / "gnuplot", fs::perms::owner_read);
  EXPECT_FALSE(find_gnuplot());
  EXPECT_EQ(run_gnuplot(folder, "x.gp"), "gnuplot was not found in PATH");
}

TEST_F(GnuplotProgram, RunsTheScriptInItsFolder) {
  if (!find_gnuplot()) GTEST_SKIP() << "no gnuplot here";
  const fs::path odd = folder / "it's a \"folder\" $HOME `ls`";
  fs::create_directory(odd);
  put(odd / "x.gp", "set print 'made'\nprint 1 + 1\n");
  EXPECT_EQ(run_gnuplot(odd, "x.gp"), "");
  EXPECT_EQ(read(odd / "made"), "2\n");
}

TEST_F(GnuplotProgram, ErrorsAreToldInALine) {
  if (!find_gnuplot()) GTEST_SKIP() << "no gnuplot here";
  put(folder / "x.gp", "plot nothing(\n");
  const std::string reason = run_gnuplot(folder, "x.gp");
  EXPECT_NE(reason.find("invalid expression"), std::string::npos) << reason;
  EXPECT_EQ(reason.find('\n'), std::string::npos);
  EXPECT_NE(run_gnuplot(folder, "absent.gp").find("absent.gp"), std::string::npos);
}

TEST_F(GnuplotProgram, WarningsAreNoErrors) {
  const Environment path = fake("cat > /dev/null\necho 'warning: odd' >&2\n");
  EXPECT_EQ(run_gnuplot(folder, "x.gp"), "");
}

TEST_F(GnuplotProgram, ItsDeathIsNotOurs) {
  const Environment path = fake("echo out of ideas >&2\nexit 3\n");
  const std::string reason = run_gnuplot(folder, "x.gp");
  EXPECT_EQ(reason, "gnuplot failed: out of ideas; exit code 3");
}

TEST_F(GnuplotProgram, IsNotStartedWithoutRoomForItsMessages) {
  const Environment path = fake("exit 0\n");
  const Environment nowhere("TMPDIR", (folder / "none").string());
  EXPECT_NE(run_gnuplot(folder, "x.gp"), "");
}

TEST(GnuplotString, HasNoWayOut) {
  EXPECT_EQ(gnuplot_string("it's"), "'it''s'");
  EXPECT_EQ(gnuplot_string("a\nb\tc"), "'a b c'");
  EXPECT_EQ(gnuplot_string("κ `ls` \\ \"x\""), "'κ `ls` \\ \"x\"'");
}

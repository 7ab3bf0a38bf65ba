#include <kfstab/reports/program.hpp>

#include <chrono>

#include "reports/scratch.hpp"

using namespace kfstab::reports;
namespace fs = std::filesystem;
using std::chrono::seconds;

class Program : public ScratchFolder {
 protected:
  /// A shell script that PATH leads to.
  void install(const std::string& name, const std::string& script) {
    put(folder / name, "#!/bin/sh\n" + script + "\n");
    fs::permissions(folder / name, fs::perms::owner_all);
  }
};

TEST_F(Program, IsFoundIfItCanBeRun) {
  const Environment path("PATH", "/nowhere:" + folder.string());
  EXPECT_FALSE(find_program("tool"));
  put(folder / "tool", "no program");
  EXPECT_FALSE(find_program("tool"));
  install("tool", "exit 0");
  EXPECT_EQ(find_program("tool"), folder / "tool");
}

TEST_F(Program, TellsHowItFailed) {
  EXPECT_EQ(run_program({"/bin/true"}, seconds(10)), "");
  EXPECT_EQ(run_program({"/bin/sh", "-c", "exit 3"}, seconds(10)), "it ended with exit code 3");
  EXPECT_EQ(run_program({"/bin/sh", "-c", "kill -9 $$"}, seconds(10)), "it died of signal 9");
  EXPECT_EQ(run_program({"/nowhere/tool"}, seconds(10)), "it ended with exit code 127");
}

TEST_F(Program, ThatHangsIsKilledWithItsChildren) {
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(run_program({"/bin/sh", "-c", "sleep 100 & sleep 100"}, seconds(1)), "it had not ended after 1 s");
  EXPECT_LT(std::chrono::steady_clock::now() - begin, seconds(50));
}

TEST_F(Program, WithoutABrowserThereIsNoPdfAndAReason) {
  const Environment path("PATH", folder.string());
  EXPECT_EQ(print_pdf(folder / "page.html", folder / "page.pdf"), "chromium was not found in PATH");
  // One that fails, one that leaves half a file, one that does its work.
  const std::string target = "for word; do case $word in --print-to-pdf=*) out=${word#*=};; esac; done; ";
  install("chromium", "exit 1");
  EXPECT_EQ(print_pdf(folder / "page.html", folder / "page.pdf"), "chromium failed: it ended with exit code 1");
  install("chromium", target + "echo %PDF-1.4 >$out");
  EXPECT_EQ(print_pdf(folder / "page.html", folder / "page.pdf"), "chromium failed: it left no complete file");
  EXPECT_FALSE(fs::exists(folder / "page.pdf"));
  install("chromium", target + "echo %PDF-1.4 %%EOF >$out");
  EXPECT_EQ(print_pdf(folder / "page.html", folder / "page.pdf"), "");
  EXPECT_TRUE(fs::exists(folder / "page.pdf"));
}

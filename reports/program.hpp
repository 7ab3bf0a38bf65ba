#pragma once
// Other programs that reports are made with.

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace kfstab::reports {

/// The program of that name that PATH leads to.
std::optional<std::filesystem::path> find_program(std::string_view name);

/// Runs a program, which reads nothing and whose output nobody sees, and kills it with its children when its time is
/// over. Returns why it failed, in a few words; empty if it ended well.
std::string run_program(const std::vector<std::string>& command, std::chrono::seconds limit);

/// A page as PDF, by a headless browser of the Chromium family. Returns why not; empty if `pdf` is there, whole.
std::string print_pdf(const std::filesystem::path& page, const std::filesystem::path& pdf);

}  // namespace kfstab::reports

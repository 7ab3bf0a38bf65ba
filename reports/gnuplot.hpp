#pragma once
// The program that draws. It may be absent and it may fail: both are told in words, never thrown.

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace kfstab::reports {

/// The gnuplot that PATH leads to.
std::optional<std::filesystem::path> find_gnuplot();

/// Runs the script in the folder, where its relative names are looked up and its pictures appear. The user's gnuplot
/// settings are not read. Returns why it failed, in a line; empty if all went well.
std::string run_gnuplot(const std::filesystem::path& folder, std::string_view script);

/// The text as a gnuplot string on one line, of which nothing is a command or markup if the string is set noenhanced.
std::string gnuplot_string(std::string_view text);

}  // namespace kfstab::reports

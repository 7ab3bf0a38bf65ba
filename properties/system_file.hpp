#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include <kfstab/properties/input_error.hpp>
#include <kfstab/properties/system.hpp>

/// System files: docs/systems.md describes the format, every key of it.
namespace kfstab::properties {

enum class Format { toml, json };

/// What a user sets from outside the file.
struct Overrides {
  /// Values for names of [parameters], as numbers or expressions ("1.3", "2^-20"). An unknown name is refused.
  std::map<std::string, std::string> parameters;
  /// Instead of the file's steps. Lists and measurements may be longer than this, not shorter.
  std::optional<std::int64_t> steps;
  /// Instead of the seed of { simulate = { seed = ... } }, below 2^63; no effect on a file that does not simulate.
  std::optional<std::uint64_t> seed;
};

/// Reads a system file: JSON if its name ends in .json, else TOML. CSV files are looked for beside it. Throws InputError
/// for whatever is wrong in the file, a missing or unreadable file included.
System read_system(const std::filesystem::path& path, const Overrides& overrides = {});

/// Reads a system from memory. origin stands for the file's name in messages; CSV files are looked for in folder.
System read_system_text(std::string_view text, Format format, std::string origin, const Overrides& overrides = {},
                        const std::filesystem::path& folder = {});

/// The system as TOML that reads back as the same system, bit by bit: numbers are the shortest that round-trip, what was
/// written exactly is written again, parameters keep their values (expressions are gone), data are written row by row,
/// what is missing as "missing", but for simulated ones, which keep their seed.
std::string write_system(const System& system);

}  // namespace kfstab::properties

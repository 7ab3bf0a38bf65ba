#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include <kfstab/filters/matrix.hpp>

namespace kfstab::properties {

enum class Gaps { refused, allowed };

/// The columns NAME1 ... NAMEcount of a CSV file (NAME alone for the first of one), one row a step, as a count x rows
/// matrix, a step a column. The file's first line names its columns; columns of other names are for others. Numbers are
/// decimal, separated by commas. Where gaps are allowed a cell may be empty, or hold the word `missing`: NaN. Throws InputError, with the line, for a column that is missing, twice there or one too many,
/// a row of another width, an entry that is no finite number, a file that cannot be read or is larger than 256 MiB.
Matrix<double> read_csv(const std::filesystem::path& file, const std::string& name, Index count,
                        Gaps gaps = Gaps::refused);

/// All of a file, or an InputError: it cannot be read, is no file, or is larger than limit bytes.
std::string read_text(const std::filesystem::path& file, std::uintmax_t limit, const std::string& advice);

}  // namespace kfstab::properties

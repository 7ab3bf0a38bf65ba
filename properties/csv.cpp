#include <kfstab/properties/csv.hpp>

#include <charconv>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <limits>
#include <optional>
#include <string_view>
#include <system_error>
#include <vector>

#include <kfstab/properties/input_error.hpp>

namespace kfstab::properties {

namespace {

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t' || text.back() == '\r')) text.remove_suffix(1);
  return text;
}

/// The cells of one line. A cell in double quotes loses them; it may not hold a comma.
void split(std::string_view line, std::vector<std::string_view>& cells) {
  cells.clear();
  while (true) {
    const auto comma = line.find(',');
    std::string_view cell = trimmed(line.substr(0, comma));
    if (cell.size() >= 2 && cell.front() == '"' && cell.back() == '"') cell = trimmed(cell.substr(1, cell.size() - 2));
    cells.push_back(cell);
    if (comma == std::string_view::npos) return;
    line.remove_prefix(comma + 1);
  }
}

std::string shortened(std::string_view text) {
  return '"' + std::string(text.substr(0, 40)) + (text.size() > 40 ? "...\"" : "\"");
}

/// Which column of the file is NAMEi; refuses NAME(count + 1).
std::vector<std::size_t> find_columns(const std::vector<std::string_view>& header, const std::string& name, Index count,
                                      const Place& place) {
  std::vector<std::optional<std::size_t>> found(static_cast<std::size_t>(count));
  for (std::size_t column = 0; column < header.size(); ++column) {
    std::string_view title = header[column];
    if (!title.starts_with(name)) continue;
    title.remove_prefix(name.size());
    std::size_t number = 0;
    if (title.empty()) {
      number = 1;
    } else {
      const auto [end, error] = std::from_chars(title.data(), title.data() + title.size(), number);
      if (error != std::errc() || end != title.data() + title.size()) continue;
    }
    if (number < 1 || number > found.size())
      throw InputError(place, "a column " + shortened(header[column]), std::to_string(count) + " columns " + name + "1, ...");
    if (found[number - 1]) throw InputError(place, "the column " + name + std::to_string(number) + " twice", "it once");
    found[number - 1] = column;
  }
  std::vector<std::size_t> columns;
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (!found[i])
      throw InputError(place, "no column " + name + std::to_string(i + 1),
                       "a first line that names the columns, " + name + "1 to " + name + std::to_string(count) + " among them");
    columns.push_back(*found[i]);
  }
  return columns;
}

double number_in(std::string_view cell, const Place& place) {
  std::string_view digits = cell;
  if (digits.starts_with('+')) digits.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error == std::errc::result_out_of_range || (error == std::errc() && end == digits.data() + digits.size() && !std::isfinite(value)))
    throw InputError(place, shortened(cell), "a finite number within the range of double");
  if (error != std::errc() || end != digits.data() + digits.size())
    throw InputError(place, cell.empty() ? "an empty cell" : shortened(cell), "a number");
  return value;
}

}  // namespace

std::string read_text(const std::filesystem::path& file, std::uintmax_t limit, const std::string& advice) {
  const Place place{file.string(), 0, 0, {}, {}};
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) throw InputError(place, "no such file", "a file that can be read");
  if (std::filesystem::is_directory(status)) throw InputError(place, "a folder", "a file");
  if (std::filesystem::is_regular_file(status)) {
    const auto size = std::filesystem::file_size(file, error);
    if (!error && size > limit)
      throw InputError(place, std::to_string(size) + " bytes", "at most " + std::to_string(limit) + advice);
  }
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw InputError(place, "a file that cannot be opened", "a file that can be read");
  // A pipe has no size: read no more than the limit of it.
  std::string text;
  std::vector<char> block(1 << 16);
  while (stream.read(block.data(), static_cast<std::streamsize>(block.size())) || stream.gcount() > 0) {
    text.append(block.data(), static_cast<std::size_t>(stream.gcount()));
    if (text.size() > limit) throw InputError(place, "more than " + std::to_string(limit) + " bytes", "fewer" + advice);
  }
  if (stream.bad()) throw InputError(place, "a file that cannot be read to its end", "a file that can be read");
  return text;
}

Matrix<double> read_csv(const std::filesystem::path& file, const std::string& name, Index count, Gaps gaps) {
  const std::string text = read_text(file, std::uintmax_t{256} << 20, " bytes in a CSV file");
  Place place{file.string(), 1, 0, {}, {}};

  std::string_view rest = text;
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
  const auto next_line = [&rest] {
    const auto end = rest.find('\n');
    const std::string_view line = rest.substr(0, end);
    rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
    return line;
  };

  std::vector<std::string_view> cells;
  split(next_line(), cells);
  const std::vector<std::string> titles(cells.begin(), cells.end());
  const std::vector<std::size_t> columns = find_columns(cells, name, count, place);

  std::vector<double> values;
  Index rows = 0;
  while (!rest.empty()) {
    const std::string_view line = next_line();
    ++place.line;
    place.field.clear();
    if (rest.empty() && trimmed(line).empty()) break;
    split(line, cells);
    if (cells.size() != titles.size())
      throw InputError(place, std::to_string(cells.size()) + " cells", std::to_string(titles.size()) + ", as the first line has");
    for (const std::size_t column : columns) {
      place.field = titles[column];
      const bool gap = gaps == Gaps::allowed && (cells[column].empty() || cells[column] == "missing");
      values.push_back(gap ? std::numeric_limits<double>::quiet_NaN() : number_in(cells[column], place));
    }
    ++rows;
  }
  return Eigen::Map<const Matrix<double>>(values.data(), count, rows);
}

}  // namespace kfstab::properties

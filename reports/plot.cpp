#include <kfstab/reports/plot.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <numeric>
#include <set>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include <kfstab/reports/gnuplot.hpp>
#include <kfstab/reports/heat_map.hpp>
#include <kfstab/reports/number.hpp>
#include <kfstab/reports/scale.hpp>
#include <kfstab/reports/script.hpp>
#include <kfstab/reports/terminal.hpp>

namespace kfstab::reports {
namespace {

namespace fs = std::filesystem;

void check(const Figure& figure) {
  const auto refuse = [&](const std::string& why) {
    throw std::invalid_argument(fmt::format("figure {:?}: {}", figure.id, why));
  };
  const auto allowed = [](unsigned char c) { return std::isalnum(c) || c == '-'; };
  if (figure.id.empty() || !std::all_of(figure.id.begin(), figure.id.end(), allowed))
    refuse("its id must be letters, digits and `-`, for it names files");
  std::set<std::string_view> ids;
  for (const Curve& curve : figure.curves) {
    if (curve.x.size() != curve.y.size())
      refuse(fmt::format("curve {:?} has {} values of x and {} of y", curve.id, curve.x.size(), curve.y.size()));
    if (!ids.insert(curve.id).second) refuse(fmt::format("two curves have the id {:?}", curve.id));
  }
  const HeatMaps& maps = figure.maps;
  if (!maps.panels.empty() && !figure.curves.empty()) refuse("it has curves and heat maps");
  for (const auto& [values, log] : {std::pair{&maps.x, figure.x.log}, {&maps.y, figure.y.log}}) {
    if (std::adjacent_find(values->begin(), values->end(), [](double a, double b) { return !(a < b); }) !=
        values->end())
      refuse("x and y of its heat maps must increase");
    if (!values->empty() && log && !(values->front() > 0))
      refuse("x and y of heat maps must be positive on a log axis");
  }
  for (const HeatMap& panel : maps.panels) {
    const std::size_t cells = maps.x.size() * maps.y.size();
    if (panel.values.size() != cells)
      refuse(fmt::format("heat map {:?} has {} values for {} cells", panel.id, panel.values.size(), cells));
    if (!panel.outlined.empty() && panel.outlined.size() != cells)
      refuse(fmt::format("heat map {:?} says of {} cells whether they are outlined, and has {}", panel.id,
                         panel.outlined.size(), cells));
    if (!ids.insert(panel.id).second) refuse(fmt::format("two heat maps have the id {:?}", panel.id));
  }
}

// ---- Data files ----------------------------------------------------------------------------------------------------

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

std::string heat_map_csv(const Figure& figure) {
  std::string text = "map,x,y,value,outlined\n";
  const HeatMaps& maps = figure.maps;
  for (const HeatMap& panel : maps.panels)
    for (std::size_t cell = 0; cell < panel.values.size(); ++cell)
      fmt::format_to(std::back_inserter(text), "{},{},{},{},{}\n", csv_field(panel.id),
                     exact_number(maps.x[cell % maps.x.size()]), exact_number(maps.y[cell / maps.x.size()]),
                     exact_number(panel.values[cell]), !panel.outlined.empty() && panel.outlined[cell] ? 1 : 0);
  return text;
}

std::string csv_of(const Figure& figure) {
  if (!figure.maps.panels.empty()) return heat_map_csv(figure);
  std::string text = "curve,role,x,y\n";
  for (const Curve& curve : figure.curves)
    for (std::size_t k = 0; k < curve.x.size(); ++k)
      fmt::format_to(std::back_inserter(text), "{},{},{},{}\n", csv_field(curve.id), name(curve.role),
                     exact_number(curve.x[k]), exact_number(curve.y[k]));
  return text;
}

std::string read_file(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// What the last line of a whole picture says.
const std::map<std::string, std::string_view> last_words{
    {".svg", "</svg>"}, {".png", "IEND"}, {".pdf", "%%EOF"}, {".tex", "\\endgroup"}};

/// gnuplot does not tell of a full disk: a picture is there if its end is.
bool is_complete(const fs::path& picture, std::string_view end) {
  const std::string content = read_file(picture);
  const std::size_t at = content.rfind(end);
  return at != std::string::npos && content.size() - at < end.size() + 16;
}

}  // namespace

std::vector<std::string> files_of(const Figure& figure, const Drawing& drawing) {
  std::vector<std::string> names = pictures_of(figure, drawing);
  for (const char* ending : {".csv", ".gp", ".dat"}) names.push_back(figure.id + ending);
  return names;
}

void write_sources(const Figure& figure, const Folder& folder, const Drawing& drawing) {
  check(figure);
  folder.announce(files_of(figure, drawing));
  folder.write(figure.id + ".csv", csv_of(figure));
  folder.write(figure.id + ".dat", data_of(figure));
  folder.write(figure.id + ".gp", script_of(figure, drawing));
}

PlotResult draw_figure(const Figure& figure, const Folder& folder, const Drawing& drawing) {
  std::string reason = run_gnuplot(folder.path(), figure.id + ".gp");
  const std::vector<std::string> pictures = pictures_of(figure, drawing);
  const bool complete = std::ranges::all_of(pictures, [&](const std::string& name) {
    return is_complete(folder.path() / name, last_words.at(name.substr(name.rfind('.'))));
  });
  if (reason.empty() && !complete) reason = "gnuplot failed: it left no complete picture";
  if (reason.empty()) return {.drawn = true, .warning = {}};

  std::error_code ignored;
  for (const std::string& name : pictures) fs::remove(folder.path() / name, ignored);
  return {.drawn = false,
          .warning = fmt::format("no picture of {}: {}; its data and script are in {}", figure.id, reason,
                                 folder.path().string())};
}

PlotResult write_figure(const Figure& figure, const Folder& folder, const Drawing& drawing) {
  write_sources(figure, folder, drawing);
  return draw_figure(figure, folder, drawing);
}

std::string read_svg(const Figure& figure, const Folder& folder) {
  return read_file(folder.path() / (figure.id + ".svg"));
}

// ---- Terminal ------------------------------------------------------------------------------------------------------

namespace {

/// A folder that is gone when this is.
class Scratch {
 public:
  Scratch() {
    std::error_code error;
    const fs::path temporary = fs::temp_directory_path(error);
    std::string name = (temporary / "kfstab-plot-XXXXXX").string();
    if (!error && ::mkdtemp(name.data()) != nullptr) path_ = name;
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  ~Scratch() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

/// How the dumb terminal draws one curve, and the character by which the legend names it.
struct TextStyle {
  std::string commands;
  char key;
};

/// In the order of the figure: letters for what was measured, lines of = or % or @ or # for theory, of + for envelopes.
std::vector<TextStyle> text_styles(const Figure& figure, int width) {
  constexpr std::array<std::pair<int, char>, 4> theory_lines{{{7, '='}, {4, '%'}, {5, '@'}, {2, '#'}}};
  int letters = 0;
  std::size_t theories = 0;
  std::vector<TextStyle> styles;
  for (const Curve& curve : figure.curves) {
    if (curve.role == CurveRole::envelope) {
      styles.push_back({"lines lt 0", '+'});
    } else if (curve.role == CurveRole::theory) {
      const auto& [type, key] = theory_lines[theories++ % theory_lines.size()];
      styles.push_back({fmt::format("lines lt {}", type), key});
    } else {
      const int letter = letters++ % 26;
      const bool joined = curve.role == CurveRole::measured_line && static_cast<int>(curve.x.size()) < width / 2;
      styles.push_back({fmt::format("{} lt 1 pt {}", joined ? "linespoints" : "points", letter + 1),
                        static_cast<char>('A' + letter)});
    }
  }
  return styles;
}

/// The legend in as many columns as fit.
std::string text_legend(const Figure& figure, const std::vector<TextStyle>& styles, int width) {
  std::vector<std::string> entries;
  std::size_t widest = 0;
  for (std::size_t c = 0; c < styles.size(); ++c) {
    entries.push_back(fmt::format("{} {}", styles[c].key, one_line(figure.curves[c].label)));
    widest = std::max(widest, display_width(entries.back()));
  }
  constexpr std::size_t indent = 2, between = 3;
  const std::size_t columns =
      std::max<std::size_t>(1, (static_cast<std::size_t>(width) - indent + between) / (widest + between));
  std::string text;
  for (std::size_t e = 0; e < entries.size(); ++e) {
    const bool last = (e + 1) % columns == 0 || e + 1 == entries.size();
    if (e % columns == 0) text.append(indent, ' ');
    text += entries[e];
    if (last)
      text += '\n';
    else
      text.append(widest - display_width(entries[e]) + between, ' ');
  }
  return text;
}

/// Without gnuplot's form feed, trailing blanks and empty lines at both ends.
std::string trimmed(const std::string& drawing) {
  std::string text, line, pending;
  for (char c : drawing) {
    if (c == '\f') continue;
    if (c != '\n') {
      line += c;
      continue;
    }
    line.erase(line.find_last_not_of(" \r") + 1);
    pending += line + '\n';
    if (!line.empty()) text += text.empty() ? line + '\n' : pending;
    if (!line.empty() || text.empty()) pending.clear();
    line.clear();
  }
  return text;
}

}  // namespace

TextPlot text_plot(const Figure& whole, int width, int height) {
  check(whole);
  Figure figure = whole;  // of letters, quartiles would be no more than a confusion
  std::erase_if(figure.curves, [](const Curve& curve) { return curve.role == CurveRole::quartile; });
  width = std::clamp(width, 40, 400);
  if (!figure.maps.panels.empty())
    return {.text = fmt::format("{}\n{}, of {} and (down) {}\n{}", one_line(figure.title),
                                one_line(figure.maps.color.label), one_line(figure.x.label), one_line(figure.y.label),
                                heat_map_text(figure, width)),
            .warning = {}};
  const std::vector<TextStyle> styles = text_styles(figure, width);
  const std::string legend = text_legend(figure, styles, width);
  // gnuplot would put the label of y across the plot; above the axis it has room.
  const std::string heading = fmt::format("{}\n{}\n", one_line(figure.title), one_line(figure.y.label));
  const auto lines = [](const std::string& text) {
    return static_cast<int>(std::count(text.begin(), text.end(), '\n'));
  };
  const int rows = std::clamp(height - lines(heading) - lines(legend), 12, 200);

  const Scratch scratch;
  if (scratch.path().empty()) return {.text = {}, .warning = "no folder could be made for gnuplot's output"};

  const Scales scales = scales_of(figure);
  std::string script = fmt::format(
      "reset\nset encoding utf8\nset terminal dumb mono noenhanced size {},{}\nset output 'text'\n", width, rows);
  script += "set border 3\nset tics nomirror\nset format '%g'\nunset key\n";
  script += axis_commands("x", figure.x, scales.x, PowerNotation::plain, width / 12);
  script += axis_commands("y", figure.y, scales.y, PowerNotation::plain, rows / 3) + "unset ylabel\n";
  bool first = true;
  for (std::size_t c : drawing_order(figure)) {
    script += fmt::format("{}'data' index {} using (shown_x($1)):(shown_y($2)) with {}", first ? "plot " : ", ", c,
                          styles[c].commands);
    first = false;
  }
  script += first ? "plot NaN\n" : "\n";
  try {
    write_file(scratch.path() / "data", data_of(figure));
    write_file(scratch.path() / "script", script);
  } catch (const FileError& error) {
    return {.text = {}, .warning = error.what()};
  }
  if (std::string reason = run_gnuplot(scratch.path(), "script"); !reason.empty())
    return {.text = {}, .warning = std::move(reason)};
  std::string text = trimmed(read_file(scratch.path() / "text"));
  if (text.empty()) return {.text = {}, .warning = "gnuplot failed: it drew nothing"};
  return {.text = heading + text + legend, .warning = {}};
}

}  // namespace kfstab::reports

// SPDX-License-Identifier: MIT
// How the curricula of Lee et al. 2021, s7.3, explore a skill that spreads from where it is mastered and fades with
// failures (the tests' analytic model: no character, no policy). Five schedules, 20 seeds each: the share of the task
// space explored after every fifth batch, mean and 95 % interval of the mean, as curriculum.csv and curriculum.svg in
// the folder named by the argument (default: the present one). Prints one line a schedule at the end of practice; fails
// if the paper's order does not hold: adaptive covers all, exploring first and alternating less, uniform stalls.
#include <array>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/executor.hpp>
#include <traceur/evaluate/confidence.hpp>
#include <traceur/io/atomic_file.hpp>
#include <traceur/io/csv.hpp>

#include "../tests/parameterize/spreading.hpp"

namespace {

using namespace traceur;
using parameterize::Schedule;

constexpr int seeds = 20, batches = 200, every = 5, points = batches / every;

struct Line {
  Schedule schedule;
  const char* name;
  const char* color;
};
constexpr std::array<Line, 5> lines{{{Schedule::adaptive, "adaptive", "#1b7837"},
                                     {Schedule::alternating, "alternating", "#2166ac"},
                                     {Schedule::mastering, "mastering", "#762a83"},
                                     {Schedule::explore_first, "explore first", "#b35806"},
                                     {Schedule::uniform, "uniform", "#666666"}}};

/// Mean and half the interval of the mean, in percent, at every point of every line.
struct Curves {
  Eigen::MatrixXd mean = Eigen::MatrixXd::Zero(points + 1, lines.size()), half = mean;
};

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

std::string plot(const Curves& curves) {
  constexpr double left = 60, top = 20, width = 560, height = 300;
  const auto x = [&](int k) { return left + width * k / points; };
  const auto y = [&](double percent) { return top + height * (1 - percent / 100); };
  std::string svg =
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 780 370\" font-family=\"sans-serif\" font-size=\"13\">\n"
      "<rect width=\"780\" height=\"370\" fill=\"#ffffff\"/>\n";
  for (int percent = 0; percent <= 100; percent += 25)
    svg += "<path d=\"M" + number(left) + " " + number(y(percent)) + "h" + number(width) +
           "\" stroke=\"#dddddd\"/><text x=\"52\" y=\"" + number(y(percent) + 4) + "\" text-anchor=\"end\">" +
           std::to_string(percent) + "</text>\n";
  for (int k = 0; k <= points; k += 10)
    svg +=
        "<text x=\"" + number(x(k)) + "\" y=\"338\" text-anchor=\"middle\">" + std::to_string(k * every) + "</text>\n";
  svg +=
      "<text x=\"340\" y=\"360\" text-anchor=\"middle\">batches of 20 tasks</text>\n"
      "<text transform=\"translate(16 170) rotate(-90)\" text-anchor=\"middle\">explored, %</text>\n";
  for (std::size_t l = 0; l < lines.size(); ++l) {
    const auto c = static_cast<Eigen::Index>(l);
    std::string line, band;
    for (int k = 0; k <= points; ++k) {
      line += std::string(k ? "L" : "M") + number(x(k)) + " " + number(y(curves.mean(k, c)));
      band += std::string(k ? "L" : "M") + number(x(k)) + " " + number(y(curves.mean(k, c) + curves.half(k, c)));
    }
    for (int k = points; k >= 0; --k)
      band += std::string("L") + number(x(k)) + " " + number(y(curves.mean(k, c) - curves.half(k, c)));
    const std::string color = lines[l].color, at = number(y(curves.mean(points, c)) + 4);
    svg += "<path d=\"" + band + "Z\" fill=\"" + color + "\" opacity=\"0.2\"/>\n<path d=\"" + line +
           "\" fill=\"none\" stroke=\"" + color + "\" stroke-width=\"2\"/>\n<text x=\"630\" y=\"" + at + "\" fill=\"" +
           color + "\">" + lines[l].name + "</text>\n";
  }
  return svg + "</svg>\n";
}

}  // namespace

int main(int argc, char** argv) try {
  const std::filesystem::path folder = argc > 1 ? argv[1] : ".";
  Curves curves;
  io::CsvTable table;
  table.columns = {"batch"};
  table.values.resize(points + 1, 1 + 2 * static_cast<Eigen::Index>(lines.size()));
  for (int k = 0; k <= points; ++k) table.values(k, 0) = k * every;
  core::ThreadExecutor executor(2);
  std::array<double, lines.size()> last{};
  for (std::size_t l = 0; l < lines.size(); ++l) {
    Eigen::MatrixXd explored = Eigen::MatrixXd::Zero(points + 1, seeds);
    executor.run(seeds, [&](int s) {
      spreading::practise(lines[l].schedule, static_cast<std::uint64_t>(s + 1), batches,
                          [&](int b, const auto& curriculum) {
                            if ((b + 1) % every == 0) explored((b + 1) / every, s) = 100 * curriculum.explored();
                          });
    });
    for (int k = 0; k <= points; ++k) {
      std::vector<double> values(seeds);
      for (int s = 0; s < seeds; ++s) values[static_cast<std::size_t>(s)] = explored(k, s);
      const auto interval = evaluate::mean_interval(values);
      curves.mean(k, static_cast<Eigen::Index>(l)) = interval.estimate;
      curves.half(k, static_cast<Eigen::Index>(l)) = 0.5 * (interval.high - interval.low);
    }
    const auto c = static_cast<Eigen::Index>(l);
    table.columns.push_back(std::string(lines[l].name) + " mean_percent");
    table.columns.push_back(std::string(lines[l].name) + " half_interval_percent");
    table.values.col(1 + 2 * c) = curves.mean.col(c);
    table.values.col(2 + 2 * c) = curves.half.col(c);
    last[l] = curves.mean(points, c);
    std::printf("%-14s explored after %d batches %5.1f +- %.1f %%, after %d %5.1f +- %.1f %%\n", lines[l].name,
                batches / 2, curves.mean(points / 2, c), curves.half(points / 2, c), batches, curves.mean(points, c),
                curves.half(points, c));
  }
  io::write_csv(folder / "curriculum.csv", table);
  io::write_atomically(folder / "curriculum.svg", plot(curves));
  const bool order = last[0] > 95 && last[1] < last[0] && last[3] < last[0] && last[4] < last[1];
  if (!order) std::fprintf(stderr, "curriculum: the paper's order does not hold\n");
  return order ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "curriculum: %s\n", error.what());
  return 1;
}

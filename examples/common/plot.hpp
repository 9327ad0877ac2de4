// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace example {

/// One curve of a plot.
struct Curve {
  std::string name;
  std::vector<std::pair<double, double>> points;
};

/// A line plot as an SVG element, 420 x 240. Points that are not finite are left out.
std::string plot(const std::string& title, const std::string& x_label, const std::vector<Curve>& curves);

/// How the points of a series are drawn.
enum class Mark { line, dashed_line, dot, disc, ring, square, small_ring };

/// Points of one kind in a chart.
struct Series {
  std::string name;  ///< in the legend; without one it is not there
  Mark mark = Mark::dot;
  std::string color;  ///< of CSS
  std::vector<std::pair<double, double>> points;
  /// Short texts (two characters) inside discs, rings and squares, one for each point; or none.
  std::vector<std::string> labels{};
};

/// What is written along the sides of a chart.
struct Axes {
  std::string x_label, y_label;
  std::vector<double> x_ticks{}, y_ticks{};  ///< empty: round numbers
  std::vector<std::string> y_names{};        ///< instead of the y ticks' numbers, from below; the chart is as high as they need
};

/// A chart of points and lines with a legend below, as an SVG element 420 wide. Points that are not finite are left out.
std::string chart(const std::string& title, const Axes& axes, const std::vector<Series>& series);

/// A self-contained page of plots below a table of facts.
std::string plot_page(const std::string& title, const std::vector<std::pair<std::string, std::string>>& facts,
                      const std::vector<std::string>& plots);

}  // namespace example

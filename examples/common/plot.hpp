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

/// A self-contained page of plots below a table of facts.
std::string plot_page(const std::string& title, const std::vector<std::pair<std::string, std::string>>& facts,
                      const std::vector<std::string>& plots);

}  // namespace example

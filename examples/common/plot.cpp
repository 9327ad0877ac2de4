// SPDX-License-Identifier: MIT
#include "plot.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace example {

namespace {

constexpr double width = 420, height = 240, left = 52, right = 12, top = 26, bottom = 38;
constexpr const char* colors[] = {"#2b6cb0", "#c05621", "#2f855a", "#6b46c1", "#b83280", "#718096", "#b7791f", "#0987a0"};

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&') out += "&amp;";
    else if (c == '<') out += "&lt;";
    else if (c == '>') out += "&gt;";
    else out += c;
  }
  return out;
}

std::string number(double x, const char* format = "%.4g") {
  char text[32];
  std::snprintf(text, sizeof text, format, x);
  return text;
}

struct Range {
  double least = std::numeric_limits<double>::infinity(), most = -std::numeric_limits<double>::infinity();

  void take(double x) {
    least = std::min(least, x);
    most = std::max(most, x);
  }
  void settle() {
    if (!(least <= most)) least = 0, most = 1;
    if (most - least < 1e-12) most = least + 1;
  }
  /// About five round numbers inside.
  std::vector<double> ticks() const {
    const double rough = (most - least) / 5, power = std::pow(10.0, std::floor(std::log10(rough)));
    double step = power;
    for (const double factor : {2.0, 5.0, 10.0})
      if (step < rough) step = factor * power;
    std::vector<double> out;
    for (double x = std::ceil(least / step) * step; x <= most + 1e-9 * step; x += step)
      out.push_back(std::abs(x) < 1e-9 * step ? 0 : x);
    return out;
  }
};

}  // namespace

std::string plot(const std::string& title, const std::string& x_label, const std::vector<Curve>& curves) {
  Range xs, ys;
  const auto finite = [](const std::pair<double, double>& p) { return std::isfinite(p.first) && std::isfinite(p.second); };
  for (const Curve& c : curves)
    for (const auto& p : c.points)
      if (finite(p)) {
        xs.take(p.first);
        ys.take(p.second);
      }
  xs.settle();
  ys.settle();
  const auto x = [&](double v) { return left + (v - xs.least) / (xs.most - xs.least) * (width - left - right); };
  const auto y = [&](double v) { return height - bottom - (v - ys.least) / (ys.most - ys.least) * (height - top - bottom); };
  std::string out = "<svg viewBox=\"0 0 420 240\" width=\"420\" height=\"240\" role=\"img\" font-family=\"sans-serif\" font-size=\"11\">\n";
  const auto text = [&](double at_x, double at_y, const char* anchor, const std::string& what, const std::string& more = "") {
    out += "<text x=\"" + number(at_x) + "\" y=\"" + number(at_y) + "\" text-anchor=\"" + anchor + "\"" + more + ">" +
           escaped(what) + "</text>\n";
  };
  const auto line = [&](double x0, double y0, double x1, double y1) {
    out += "<line x1=\"" + number(x0) + "\" y1=\"" + number(y0) + "\" x2=\"" + number(x1) + "\" y2=\"" + number(y1) +
           "\" stroke=\"#d0d4da\"/>\n";
  };
  text(0.5 * width, 15, "middle", title, " font-weight=\"bold\"");
  text(0.5 * (left + width - right), height - 6, "middle", x_label);
  for (const double v : xs.ticks()) {
    line(x(v), top, x(v), height - bottom);
    text(x(v), height - bottom + 14, "middle", number(v));
  }
  for (const double v : ys.ticks()) {
    line(left, y(v), width - right, y(v));
    text(left - 5, y(v) + 4, "end", number(v));
  }
  for (std::size_t k = 0; k < curves.size(); ++k) {
    const std::string color = colors[k % std::size(colors)];
    out += "<polyline fill=\"none\" stroke-width=\"1.6\" stroke=\"" + color + "\" points=\"";
    for (const auto& p : curves[k].points)
      if (finite(p)) out += number(x(p.first), "%.1f") + "," + number(y(p.second), "%.1f") + " ";
    out += "\"/>\n";
    if (curves.size() > 1)
      text(width - right - 4, top + 12 + 13 * static_cast<double>(k), "end", curves[k].name, " fill=\"" + color + "\"");
  }
  return out + "</svg>\n";
}

std::string plot_page(const std::string& title, const std::vector<std::pair<std::string, std::string>>& facts,
                      const std::vector<std::string>& plots) {
  std::string out = "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>" + escaped(title) +
                    "</title>\n<style>body{font:14px sans-serif;max-width:900px;margin:2em auto;padding:0 1em}"
                    "td{padding:2px 12px 2px 0}svg{margin:4px}</style></head><body>\n<h1>" +
                    escaped(title) + "</h1>\n<table>\n";
  for (const auto& [name, value] : facts) out += "<tr><td>" + escaped(name) + "</td><td>" + escaped(value) + "</td></tr>\n";
  out += "</table>\n";
  for (const std::string& p : plots) out += p;
  return out + "</body></html>\n";
}

}  // namespace example

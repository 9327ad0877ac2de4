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
  /// About `count` round numbers inside, or fewer.
  std::vector<double> ticks(int count = 5) const {
    const double rough = (most - least) / count, power = std::pow(10.0, std::floor(std::log10(rough)));
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

namespace {

constexpr double row = 44, mark_radius = 8.5, letter = 6;  // of a chart, in pixels

bool lines(Mark m) { return m == Mark::line || m == Mark::dashed_line; }

void draw_mark(std::string& out, Mark mark, const std::string& color, double x, double y, const std::string& label) {
  const std::string at = "cx=\"" + number(x) + "\" cy=\"" + number(y) + "\" ";
  const auto circle = [&](double r, const std::string& look) { out += "<circle " + at + "r=\"" + number(r) + "\" " + look + "/>\n"; };
  const std::string filled = "fill=\"" + color + "\"", open = "fill=\"#fff\" stroke-width=\"1.6\" stroke=\"" + color + "\"";
  if (mark == Mark::dot) circle(3.2, filled);
  if (mark == Mark::disc) circle(mark_radius, filled);
  if (mark == Mark::ring) circle(mark_radius, open);
  if (mark == Mark::small_ring) circle(3.2, open);
  if (mark == Mark::square) {
    const double half = 0.9 * mark_radius;
    out += "<rect x=\"" + number(x - half) + "\" y=\"" + number(y - half) + "\" width=\"" + number(2 * half) + "\" height=\"" +
           number(2 * half) + "\" " + open + "/>\n";
  }
  if (!label.empty())
    out += "<text x=\"" + number(x) + "\" y=\"" + number(y + 3.6) + "\" text-anchor=\"middle\" font-size=\"10\" fill=\"" +
           (mark == Mark::disc ? "#fff" : "#222") + "\">" + escaped(label) + "</text>\n";
}

void draw_line(std::string& out, Mark mark, const std::string& color, const std::string& points) {
  out += "<polyline fill=\"none\" stroke-width=\"1.6\" stroke=\"" + color + "\"" +
         (mark == Mark::dashed_line ? " stroke-dasharray=\"5 4\"" : "") + " points=\"" + points + "\"/>\n";
}

}  // namespace

std::string chart(const std::string& title, const Axes& axes, const std::vector<Series>& series) {
  Range xs, ys;
  const auto finite = [](const std::pair<double, double>& p) { return std::isfinite(p.first) && std::isfinite(p.second); };
  for (const Series& s : series)
    for (const auto& p : s.points)
      if (finite(p)) {
        xs.take(p.first);
        ys.take(p.second);
      }
  for (const double v : axes.x_ticks) xs.take(v);
  for (const double v : axes.y_ticks) ys.take(v);
  xs.settle();
  ys.settle();
  const std::vector<double> x_ticks = axes.x_ticks.empty() ? xs.ticks(8) : axes.x_ticks;
  const std::vector<double> y_ticks = axes.y_ticks.empty() ? ys.ticks(8) : axes.y_ticks;
  std::size_t longest = 4;
  for (const std::string& name : axes.y_names) longest = std::max(longest, name.size());
  const double plane = axes.y_names.empty() ? 250 : 30 + row * static_cast<double>(axes.y_names.size());
  // Marks stay off the sides.
  const double inset = 14, begin = 26 + letter * static_cast<double>(longest), end = width - right, low = top + plane;
  const auto x = [&](double v) { return begin + inset + (v - xs.least) / (xs.most - xs.least) * (end - begin - 2 * inset); };
  const auto y = [&](double v) { return low - inset - (v - ys.least) / (ys.most - ys.least) * (plane - 2 * inset); };
  std::string body;
  const auto text = [&](double at_x, double at_y, const char* anchor, const std::string& what, const std::string& more = "") {
    body += "<text x=\"" + number(at_x) + "\" y=\"" + number(at_y) + "\" text-anchor=\"" + anchor + "\"" + more + ">" + escaped(what) +
            "</text>\n";
  };
  const auto line = [&](double x0, double y0, double x1, double y1) {
    body += "<line x1=\"" + number(x0) + "\" y1=\"" + number(y0) + "\" x2=\"" + number(x1) + "\" y2=\"" + number(y1) +
            "\" stroke=\"#d0d4da\"/>\n";
  };
  text(0.5 * (begin + end), 15, "middle", title, " font-weight=\"bold\"");
  for (const double v : x_ticks) {
    line(x(v), top, x(v), low);
    text(x(v), low + 14, "middle", number(v));
  }
  for (std::size_t i = 0; i < y_ticks.size(); ++i) {
    line(begin, y(y_ticks[i]), end, y(y_ticks[i]));
    text(begin - 5, y(y_ticks[i]) + 4, "end", i < axes.y_names.size() ? axes.y_names[i] : number(y_ticks[i]));
  }
  body += "<rect x=\"" + number(begin) + "\" y=\"" + number(top) + "\" width=\"" + number(end - begin) + "\" height=\"" + number(plane) +
          "\" fill=\"none\" stroke=\"#a0a6ae\"/>\n";
  text(0.5 * (begin + end), low + 31, "middle", axes.x_label);
  const double middle = top + 0.5 * plane;
  text(12, middle, "middle", axes.y_label, " transform=\"rotate(-90 12 " + number(middle) + ")\"");
  double legend_x = begin, legend_y = low + 53;
  for (const Series& s : series) {
    std::string points;
    for (std::size_t i = 0; i < s.points.size(); ++i) {
      if (!finite(s.points[i])) continue;
      const double px = x(s.points[i].first), py = y(s.points[i].second);
      if (lines(s.mark))
        points += number(px, "%.1f") + "," + number(py, "%.1f") + " ";
      else
        draw_mark(body, s.mark, s.color, px, py, i < s.labels.size() ? s.labels[i] : "");
    }
    if (lines(s.mark)) draw_line(body, s.mark, s.color, points);
    if (s.name.empty()) continue;
    const double wide = 28 + letter * static_cast<double>(s.name.size());
    if (legend_x > begin && legend_x + wide > end) {
      legend_x = begin;
      legend_y += 21;
    }
    const double sign_y = legend_y - 4;
    if (lines(s.mark))
      draw_line(body, s.mark, s.color, number(legend_x) + "," + number(sign_y) + " " + number(legend_x + 18) + "," + number(sign_y));
    else
      draw_mark(body, s.mark, s.color, legend_x + 9, sign_y, "");
    text(legend_x + 23, legend_y, "start", s.name);
    legend_x += wide + 10;
  }
  const std::string height_now = number(legend_y + 12);
  return "<svg viewBox=\"0 0 420 " + height_now + "\" width=\"420\" height=\"" + height_now +
         "\" role=\"img\" font-family=\"sans-serif\" font-size=\"11\">\n" + body + "</svg>\n";
}

std::string plot_page(const std::string& title, const std::vector<std::pair<std::string, std::string>>& facts,
                      const std::vector<std::string>& plots) {
  std::string out = "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>" + escaped(title) +
                    "</title>\n<style>body{font:14px sans-serif;max-width:900px;margin:2em auto;padding:0 1em}"
                    "td{padding:2px 12px 2px 0}svg{margin:4px;vertical-align:top}</style></head><body>\n<h1>" +
                    escaped(title) + "</h1>\n<table>\n";
  for (const auto& [name, value] : facts) out += "<tr><td>" + escaped(name) + "</td><td>" + escaped(value) + "</td></tr>\n";
  out += "</table>\n";
  for (const std::string& p : plots) out += p;
  return out + "</body></html>\n";
}

}  // namespace example

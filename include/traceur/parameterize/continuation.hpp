// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <istream>
#include <limits>
#include <optional>
#include <ostream>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/core/error.hpp>
#include <traceur/core/executor.hpp>
#include <traceur/core/hex_words.hpp>
#include <traceur/parameterize/rbf.hpp>

namespace traceur::parameterize {

enum class Strategy {
  /// Terrain Runner s4.1.2 and Fig. 3d: extrapolate from what is solved, try it all around, optimise the outer boundary
  /// of
  /// what worked, repeat.
  predictor_corrector,
  /// Fig. 3a and b: along the first axis from the seed, then along the second from every node of the first, and so on;
  /// each node is optimised from the control of the node before. The baseline.
  axis_by_axis
};

struct ContinuationParameters {
  /// The values of each task parameter, strictly increasing; the nodes are all combinations.
  std::vector<Eigen::VectorXd> axes;
  Strategy strategy = Strategy::predictor_corrector;
  /// Basis function and units of the task parameters for the prediction.
  Kernel kernel = Kernel::linear;
  Eigen::VectorXd unit;
  /// How often a node is optimised at most; again only once more nodes have been solved.
  int max_attempts = 2;
  /// Whether nodes whose predicted control worked are tested once more with the last prediction, and optimised where it
  /// fails. Without, each is covered by the prediction of its round only.
  bool verify = true;
  /// Asks for nothing more once so many evaluations are told; 0 for no limit.
  std::int64_t max_evaluations = 0;
};

/// What is known of a node.
enum class NodeStatus {
  untried,
  solved,        ///< optimised; a centre of the prediction
  extrapolated,  ///< the predicted control worked as it was
  failed         ///< neither worked so far
};

/// A job for the user: whether a control does what the node's task parameters ask for, or, starting from it, a control
/// that does.
struct ContinuationTask {
  enum class Kind { test, optimize };
  Kind kind = Kind::test;
  int node = 0;
  Eigen::VectorXd parameter;
  Eigen::VectorXd control;
};

struct ContinuationResult {
  bool works = false;
  /// The optimised control; ignored of tests and failures.
  Eigen::VectorXd control;
  double cost = std::numeric_limits<double>::infinity();
  /// What the job cost, such as simulated episodes; >= 1.
  std::int64_t evaluations = 1;
};

/// Does one job: `f(task)`, or `f(task, worker)` where it needs memory of its worker's own. Laws as of a
/// `core::Executor`'s jobs; the result depends on the task alone.
template <class F>
concept TaskSolver = requires(F& f, const ContinuationTask& task) {
  { f(task) } -> std::convertible_to<ContinuationResult>;
}
|| requires(F& f, const ContinuationTask& task, int worker) {
  { f(task, worker) } -> std::convertible_to<ContinuationResult>;
};

/// Spreads one solved skill over a grid of task parameters theta. Whoever owns the loop does the jobs:
///
///     while (!continuation.finished()) {
///       results.clear();
///       for (const ContinuationTask& task : continuation.ask()) results.push_back(do_it(task));
///       continuation.tell(results);
///     }
///     Eigen::VectorXd control = continuation.model()(theta);
///
/// One round of the predictor-corrector: an RBF is fitted to all solved nodes; nodes next to working ones are tested
/// with its prediction, and so on outwards, breadth first, until a ring of failures surrounds all that works. Then the
/// working but unsolved nodes that touch a failure are optimised, from the prediction. Where nothing new works, the
/// failures that touch a working node are optimised instead. The next round starts with the solved set so enlarged. It
/// ends when all nodes work or a round changes nothing.
///
/// All jobs of one `ask` are independent. The order is fixed by the grid and the results alone.
class Continuation {
public:
  /// `seed` (n) is the node with the known `control`. Throws Error that names the parameter.
  Continuation(const ContinuationParameters& parameters, const Eigen::Ref<const Eigen::VectorXd>& seed,
               const Eigen::Ref<const Eigen::VectorXd>& control)
      : parameters_(parameters) {
    check_parameters();
    controls_ = static_cast<int>(control.size());
    require(controls_ >= 1 && control.allFinite(), "control", "one or more finite numbers");
    require(seed.size() == dimension(), "seed", std::to_string(dimension()) + " task parameters");
    nodes_.resize(static_cast<std::size_t>(node_count()));
    seed_ = 0;
    int stride = 1;
    for (Eigen::Index d = 0; d < dimension(); ++d) {
      const Eigen::VectorXd& axis = parameters_.axes[index(d)];
      Eigen::Index nearest = 0;
      (axis.array() - seed(d)).abs().minCoeff(&nearest);
      require(std::abs(axis(nearest) - seed(d)) <= 1e-9 * (axis(axis.size() - 1) - axis(0) + std::abs(seed(d))), "seed",
              "a node of the grid, got " + std::to_string(seed(d)) + " on axis " + std::to_string(d));
      seed_ += stride * static_cast<int>(nearest);
      stride *= static_cast<int>(axis.size());
    }
    Node& node = nodes_[index(seed_)];
    node.status = NodeStatus::solved;
    node.control = control;
    node.cost = 0.0;
    solved_ = 1;
    begin();
  }

  Eigen::Index dimension() const noexcept { return static_cast<Eigen::Index>(parameters_.axes.size()); }
  /// The number of nodes of the grid. Node numbers count along the first axis fastest.
  int node_count() const noexcept {
    int count = 1;
    for (const Eigen::VectorXd& axis : parameters_.axes) count *= static_cast<int>(axis.size());
    return count;
  }
  const ContinuationParameters& parameters() const noexcept { return parameters_; }
  /// The task parameters (n) of a node.
  Eigen::VectorXd parameter(int node) const {
    Eigen::VectorXd theta(dimension());
    for (Eigen::Index d = 0; d < dimension(); ++d) {
      const Eigen::VectorXd& axis = parameters_.axes[index(d)];
      theta(d) = axis(node % static_cast<int>(axis.size()));
      node /= static_cast<int>(axis.size());
    }
    return theta;
  }
  /// The node the continuation started from.
  int seed() const noexcept { return seed_; }
  NodeStatus status(int node) const noexcept { return nodes_[index(node)].status; }
  /// The control that works at a node, or an empty vector.
  const Eigen::VectorXd& control(int node) const noexcept { return nodes_[index(node)].control; }
  /// The cost told with that control.
  double cost(int node) const noexcept { return nodes_[index(node)].cost; }
  /// Which of the predictions (counted from 1) it was last tested with; 0 for none.
  int tested_round(int node) const noexcept { return std::max(0, nodes_[index(node)].tested_round); }

  /// The jobs of this step; the same ones until `tell`. Empty once finished.
  const std::vector<ContinuationTask>& ask() const noexcept { return tasks_; }

  /// Takes one result for each job, in their order. Throws Error, and changes nothing, if their number or the size of a
  /// control is wrong.
  void tell(std::span<const ContinuationResult> results) {
    require(results.size() == tasks_.size(), "tell",
            std::to_string(tasks_.size()) + " results, got " + std::to_string(results.size()));
    for (std::size_t i = 0; i < results.size(); ++i) {
      require(results[i].evaluations >= 1, "tell", "1 or more evaluations in result " + std::to_string(i));
      const bool counts = results[i].works && tasks_[i].kind == ContinuationTask::Kind::optimize;
      require(!counts || (results[i].control.size() == controls_ && results[i].control.allFinite()), "tell",
              std::to_string(controls_) + " finite numbers in the control of result " + std::to_string(i));
    }
    const std::vector<ContinuationTask> done = std::exchange(tasks_, {});
    for (std::size_t i = 0; i < done.size(); ++i) {
      evaluations_ += results[i].evaluations;
      (done[i].kind == ContinuationTask::Kind::test ? tests_ : optimizations_) += 1;
      learn(done[i], results[i]);
    }
    if (parameters_.max_evaluations > 0 && evaluations_ >= parameters_.max_evaluations) {
      stage_ = Stage::finished;
    } else if (parameters_.strategy == Strategy::axis_by_axis) {
      walk();
    } else {
      advance();
    }
  }

  /// Goes on once less is asked of controls than before: nodes that work keep what they have, all others are untried
  /// again. Jobs that were asked for and not told are forgotten.
  void retry() {
    tasks_.clear();
    rays_.clear();
    for (Node& node : nodes_) {
      node.attempts = node.solved_then = 0;
      if (node.status == NodeStatus::failed) node.status = NodeStatus::untried;
    }
    begin();
  }

  bool finished() const noexcept { return stage_ == Stage::finished; }
  /// Sum of what the jobs cost, and their number by kind.
  std::int64_t evaluations() const noexcept { return evaluations_; }
  std::int64_t tests() const noexcept { return tests_; }
  std::int64_t optimizations() const noexcept { return optimizations_; }
  /// Predictions fitted so far.
  int rounds() const noexcept { return rounds_; }
  int count(NodeStatus status) const noexcept {
    return static_cast<int>(
        std::count_if(nodes_.begin(), nodes_.end(), [&](const Node& n) { return n.status == status; }));
  }
  /// The share of nodes that work: solved or extrapolated.
  double coverage() const noexcept {
    return static_cast<double>(count(NodeStatus::solved) + count(NodeStatus::extrapolated)) / node_count();
  }

  /// The prediction from all nodes solved so far, in the order of the nodes. Its polynomial is linear as far as they
  /// extend.
  Rbf model() const {
    Eigen::MatrixXd centres(dimension(), solved_), values(controls_, solved_);
    Eigen::Index i = 0;
    for (int node = 0; node < node_count(); ++node) {
      if (status(node) != NodeStatus::solved) continue;
      centres.col(i) = parameter(node);
      values.col(i++) = control(node);
    }
    RbfParameters p;
    p.kernel = parameters_.kernel;
    p.unit = parameters_.unit;
    p.reduce = true;
    return Rbf(centres, values, p);
  }

  /// Writes the whole state as text, to the bit. Throws Error if the stream fails.
  void save(std::ostream& out) const {
    Writer writer{core::HexWordWriter(out)};
    writer.field(format);
    writer.end();
    Continuation copy = *this;
    copy.visit(writer);
    writer.field("end");
    writer.end();
    if (!out.flush()) throw Error("Continuation: save: the stream failed");
  }

  /// Continues what `save` wrote, with the same jobs to ask for. Throws Error that names the field that is missing or
  /// out of range.
  static Continuation load(std::istream& in) {
    Reader reader{core::HexWordReader(in, loading)};
    reader.field(format);
    Continuation c;
    c.visit(reader);
    reader.field("end");
    return c;
  }

private:
  static constexpr const char* format = "traceur.continuation.1";
  static constexpr const char* loading = "Continuation: load";
  static constexpr int node_limit = 10000000;

  enum class Stage { test, optimize, verify, walk, finished };

  struct Node {
    NodeStatus status = NodeStatus::untried;
    Eigen::VectorXd control;
    double cost = std::numeric_limits<double>::infinity();
    int attempts = 0;
    int solved_then = 0;    // how many nodes were solved when it was last optimised
    int tested_round = -1;  // the round in which it was last tested
    bool verified = false;  // by the present prediction
  };

  Continuation() = default;

  static std::size_t index(Eigen::Index i) noexcept { return static_cast<std::size_t>(i); }

  static void require(bool holds, const char* field, const std::string& expected) {
    if (!holds) throw Error(std::string("Continuation: ") + field + ": expected " + expected);
  }

  void check_parameters() const {
    const ContinuationParameters& p = parameters_;
    require(!p.axes.empty() && dimension() <= Rbf::max_dimension, "axes", "1 to " + std::to_string(Rbf::max_dimension));
    double count = 1.0;
    for (std::size_t d = 0; d < p.axes.size(); ++d) {
      const std::string which = "in axis " + std::to_string(d);
      require(p.axes[d].size() >= 1 && p.axes[d].allFinite(), "axes", "one or more finite values " + which);
      for (Eigen::Index i = 1; i < p.axes[d].size(); ++i) {
        require(p.axes[d](i - 1) < p.axes[d](i), "axes", "increasing values " + which);
      }
      count *= static_cast<double>(p.axes[d].size());
    }
    require(count <= node_limit, "axes", "at most " + std::to_string(node_limit) + " nodes");
    require(p.unit.size() == 0 || (p.unit.size() == dimension() && p.unit.allFinite() && p.unit.minCoeff() > 0.0),
            "unit", "none or " + std::to_string(dimension()) + " finite numbers above 0");
    require(p.max_attempts >= 1, "max_attempts", "1 or more, got " + std::to_string(p.max_attempts));
    require(p.max_evaluations >= 0, "max_evaluations", "0 (no limit) or more");
  }

  /// Calls `f` with every node next to `node` along an axis.
  template <class F>
  void for_each_next(int node, F&& f) const {
    int stride = 1, rest = node;
    for (Eigen::Index d = 0; d < dimension(); ++d) {
      const int size = static_cast<int>(parameters_.axes[index(d)].size());
      const int place = rest % size;
      if (place > 0) f(node - stride);
      if (place + 1 < size) f(node + stride);
      rest /= size;
      stride *= size;
    }
  }

  bool works(int node) const noexcept {
    return status(node) == NodeStatus::solved || status(node) == NodeStatus::extrapolated;
  }
  bool touches(int node, bool working) const {
    bool found = false;
    for_each_next(node, [&](int next) { found = found || works(next) == working; });
    return found;
  }
  bool may_optimize(int node) const noexcept {
    const Node& n = nodes_[index(node)];
    return n.attempts < parameters_.max_attempts && (n.attempts == 0 || solved_ > n.solved_then);
  }

  void learn(const ContinuationTask& task, const ContinuationResult& result) {
    Node& node = nodes_[index(task.node)];
    const bool better = result.works;
    if (task.kind == ContinuationTask::Kind::optimize) {
      ++node.attempts;
      node.solved_then = solved_;
      if (better) {
        solve(node, result.control, result.cost);
      } else if (node.status == NodeStatus::untried) {
        node.status = NodeStatus::failed;
      }
      return;
    }
    node.tested_round = rounds_;
    if (stage_ == Stage::verify) {
      node.verified = better;
      if (!better) return;
    } else {
      node.status = better ? NodeStatus::extrapolated : NodeStatus::failed;
      if (!better) return;
    }
    node.control = task.control;
    node.cost = result.cost;
  }

  void solve(Node& node, const Eigen::VectorXd& control, double cost) {
    node.status = NodeStatus::solved;
    node.control = control;
    node.cost = cost;
    ++solved_;
  }

  void begin() {
    if (parameters_.strategy == Strategy::axis_by_axis) {
      stage_ = Stage::walk;
      axis_ = -1;
      walk();
    } else {
      new_round();
      advance();
    }
  }

  void new_round() {
    ++rounds_;
    stage_ = Stage::test;
    for (Node& node : nodes_) node.verified = false;
  }

  void add_task(ContinuationTask::Kind kind, int node, Eigen::VectorXd control) {
    tasks_.push_back({kind, node, parameter(node), std::move(control)});
  }

  // Goes on from stage to stage until there is something to do.
  void advance() {
    while (tasks_.empty() && stage_ != Stage::finished) {
      if (stage_ == Stage::test) {
        ask_tests();
        if (tasks_.empty()) ask_boundary();
      } else if (stage_ == Stage::optimize) {
        new_round();
      } else {
        settle_verification();
      }
    }
  }

  void ask_tests() {
    std::optional<Rbf> rbf;
    for (int node = 0; node < node_count(); ++node) {
      if (works(node) || nodes_[index(node)].tested_round == rounds_ || !touches(node, true)) continue;
      if (!rbf) rbf.emplace(model());
      add_task(ContinuationTask::Kind::test, node, (*rbf)(parameter(node)));
    }
  }

  void ask_boundary() {
    const Rbf rbf = model();
    const auto ask_all = [&](NodeStatus status, bool beside_working) {
      for (int node = 0; node < node_count(); ++node) {
        if (this->status(node) != status || !may_optimize(node) || !touches(node, beside_working)) continue;
        add_task(ContinuationTask::Kind::optimize, node, rbf(parameter(node)));
      }
    };
    ask_all(NodeStatus::extrapolated, false);
    if (tasks_.empty()) ask_all(NodeStatus::failed, true);
    if (!tasks_.empty()) {
      stage_ = Stage::optimize;
      return;
    }
    if (!parameters_.verify) {
      stage_ = Stage::finished;
      return;
    }
    stage_ = Stage::verify;
    for (int node = 0; node < node_count(); ++node) {
      if (status(node) == NodeStatus::extrapolated) add_task(ContinuationTask::Kind::test, node, rbf(parameter(node)));
    }
  }

  // Every test with the last prediction is told. Where it failed, the control of an earlier round works: it is the
  // start of another optimisation, and where there may be none, a centre as it is. Either way the prediction improves
  // there.
  void settle_verification() {
    bool changed = false;
    for (int node = 0; node < node_count(); ++node) {
      Node& n = nodes_[index(node)];
      if (n.status != NodeStatus::extrapolated || n.verified) continue;
      changed = true;
      if (may_optimize(node)) {
        add_task(ContinuationTask::Kind::optimize, node, n.control);
      } else {
        solve(n, Eigen::VectorXd(n.control), n.cost);
      }
    }
    if (!tasks_.empty()) {
      stage_ = Stage::optimize;
    } else if (changed) {
      new_round();
    } else {
      stage_ = Stage::finished;
    }
  }

  // The next step of every ray along the present axis, from the control of the node before.
  void walk() {
    std::vector<Ray> next;
    for (const Ray& ray : rays_) {
      if (status(ray.node) == NodeStatus::solved) extend(ray, next);
    }
    while (next.empty() && axis_ + 1 < dimension()) {
      ++axis_;
      for (int node = 0; node < node_count(); ++node) {
        if (status(node) != NodeStatus::solved) continue;
        extend({node, 1}, next);
        extend({node, -1}, next);
      }
    }
    rays_ = std::move(next);
    for (const Ray& ray : rays_) {
      add_task(ContinuationTask::Kind::optimize, ray.node, control(ray.node - ray.direction * stride(axis_)));
    }
    if (tasks_.empty()) stage_ = Stage::finished;
  }

  struct Ray {
    int node;
    int direction;
  };

  int stride(Eigen::Index axis) const noexcept {
    int stride = 1;
    for (Eigen::Index d = 0; d < axis; ++d) stride *= static_cast<int>(parameters_.axes[index(d)].size());
    return stride;
  }

  // One step on, unless the grid ends there or the node is solved or asked for already.
  void extend(const Ray& ray, std::vector<Ray>& next) const {
    const int size = static_cast<int>(parameters_.axes[index(axis_)].size());
    const int place = ray.node / stride(axis_) % size + ray.direction;
    const int node = ray.node + ray.direction * stride(axis_);
    if (place < 0 || place >= size || status(node) == NodeStatus::solved) return;
    if (nodes_[index(node)].attempts >= parameters_.max_attempts) return;
    for (const Ray& other : next) {
      if (other.node == node) return;
    }
    next.push_back({node, ray.direction});
  }

  // Numbers are written as the words of their 64 bits, after the name of their field.
  struct Writer {
    core::HexWordWriter out;
    static constexpr bool reads = false;

    void field(const char* name) { out.name(name); }
    void end() { out.end_line(); }
    template <class T>
    void number(const char*, T& value, std::int64_t, std::int64_t) {
      out.word(static_cast<std::uint64_t>(static_cast<std::int64_t>(value)));
    }
    void real(const char*, double& value) { out.word(std::bit_cast<std::uint64_t>(value)); }
  };

  struct Reader {
    core::HexWordReader in;
    static constexpr bool reads = true;

    void field(const char* name) { in.expect(name); }
    void end() {}
    template <class T>
    void number(const char* name, T& value, std::int64_t low, std::int64_t high) {
      const auto read = static_cast<std::int64_t>(in.word(name));
      if (read < low || read > high) {
        fail(name, "expected " + std::to_string(low) + " to " + std::to_string(high) + ", got " + std::to_string(read));
      }
      value = static_cast<T>(read);
    }
    void real(const char* name, double& value) { value = std::bit_cast<double>(in.word(name)); }
  };

  [[noreturn]] static void fail(const std::string& name, const std::string& what) {
    throw Error(std::string(loading) + ": field '" + name + "': " + what);
  }

  // A vector whose length is part of the file.
  template <class Archive>
  static void vector(Archive& archive, const char* name, Eigen::VectorXd& values, std::int64_t longest) {
    Eigen::Index size = values.size();
    archive.number(name, size, 0, longest);
    if (Archive::reads) values.resize(size);
    for (Eigen::Index i = 0; i < size; ++i) archive.real(name, values(i));
  }

  // Reads or writes everything, in one order.
  template <class Archive>
  void visit(Archive& archive) {
    constexpr std::int64_t any = std::numeric_limits<std::int64_t>::max();
    constexpr std::int64_t any_int = std::numeric_limits<int>::max();
    const auto field = [&](const char* name, auto& value, std::int64_t low, std::int64_t high) {
      archive.field(name);
      archive.number(name, value, low, high);
      archive.end();
    };
    std::size_t axes = parameters_.axes.size();
    field("axes", axes, 1, Rbf::max_dimension);
    parameters_.axes.resize(axes);
    for (Eigen::VectorXd& axis : parameters_.axes) {
      archive.field("axis");
      vector(archive, "axis", axis, node_limit);
      archive.end();
    }
    field("strategy", parameters_.strategy, 0, 1);
    field("kernel", parameters_.kernel, 0, 2);
    archive.field("unit");
    vector(archive, "unit", parameters_.unit, Rbf::max_dimension);
    archive.end();
    field("max_attempts", parameters_.max_attempts, 1, any_int);
    field("verify", parameters_.verify, 0, 1);
    field("max_evaluations", parameters_.max_evaluations, 0, any);
    if (Archive::reads) {
      check_parameters();
      nodes_.resize(index(node_count()));
    }
    const int last = node_count() - 1;
    field("controls", controls_, 1, node_limit);
    field("seed", seed_, 0, last);
    field("solved", solved_, 1, last + 1);
    field("stage", stage_, 0, static_cast<int>(Stage::finished));
    field("rounds", rounds_, 0, any_int);
    field("axis_now", axis_, -1, dimension() - 1);
    field("evaluations", evaluations_, 0, any);
    field("tests", tests_, 0, any);
    field("optimizations", optimizations_, 0, any);
    for (Node& node : nodes_) {
      archive.field("node");
      archive.number("node", node.status, 0, 3);
      archive.number("node", node.attempts, 0, any_int);
      archive.number("node", node.solved_then, 0, last + 1);
      archive.number("node", node.tested_round, -1, any_int);
      archive.number("node", node.verified, 0, 1);
      archive.real("node", node.cost);
      vector(archive, "node", node.control, controls_);
      archive.end();
    }
    std::size_t count = rays_.size();
    field("rays", count, 0, last + 1);
    rays_.resize(count);
    for (Ray& ray : rays_) {
      archive.field("ray");
      archive.number("ray", ray.node, 0, last);
      archive.number("ray", ray.direction, -1, 1);
      archive.end();
    }
    count = tasks_.size();
    field("tasks", count, 0, last + 1);
    tasks_.resize(count);
    for (ContinuationTask& task : tasks_) {
      archive.field("task");
      archive.number("task", task.kind, 0, 1);
      archive.number("task", task.node, 0, last);
      vector(archive, "task", task.control, controls_);
      archive.end();
    }
    if constexpr (Archive::reads) check_state();
  }

  void check_state() {
    for (ContinuationTask& task : tasks_) {
      task.parameter = parameter(task.node);
      if (task.control.size() != controls_ || !task.control.allFinite())
        fail("task", "expected a whole control");
    }
    for (int node = 0; node < node_count(); ++node) {
      const Eigen::VectorXd& control = this->control(node);
      if ((works(node) && control.size() != controls_) || !control.allFinite()) {
        fail("node", "expected a whole control of node " + std::to_string(node));
      }
    }
    if (solved_ != count(NodeStatus::solved)) fail("solved", "expected as many as there are solved nodes");
    if (tasks_.empty() != finished()) fail("tasks", "expected none once finished, and some before");
  }

  ContinuationParameters parameters_;
  std::vector<Node> nodes_;
  int controls_ = 0;
  int seed_ = 0;
  int solved_ = 0;
  Stage stage_ = Stage::test;
  int rounds_ = 0;
  Eigen::Index axis_ = -1;
  std::int64_t evaluations_ = 0;
  std::int64_t tests_ = 0;
  std::int64_t optimizations_ = 0;
  std::vector<Ray> rays_;
  std::vector<ContinuationTask> tasks_;
};

/// Asks, solves and tells until the continuation has finished. What the solver throws comes out here and leaves the
/// continuation as it was before that `tell`.
template <TaskSolver F, core::Executor E>
void run(Continuation& continuation, F&& solver, E& executor) {
  std::vector<ContinuationResult> results;
  while (!continuation.finished()) {
    const std::vector<ContinuationTask>& tasks = continuation.ask();
    results.assign(tasks.size(), {});
    executor.run(static_cast<int>(tasks.size()), [&](int i, int worker) {
      const auto k = static_cast<std::size_t>(i);
      if constexpr (requires { solver(tasks[k], worker); }) {
        results[k] = solver(tasks[k], worker);
      } else {
        (void)worker;
        results[k] = solver(tasks[k]);
      }
    });
    continuation.tell(results);
  }
}

}  // namespace traceur::parameterize

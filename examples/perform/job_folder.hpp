// SPDX-License-Identifier: MIT
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "traceur/control/learn_feedback.hpp"
#include "traceur/control/sampling_control.hpp"

namespace perform {

/// A search for motor targets that is done.
struct SavedSearch {
  traceur::control::SampledControl result;
  double wall_s = 0;
};

/// Learning under way or done.
struct SavedLearning {
  traceur::control::FeedbackProgress progress;
  traceur::optimize::CmaEs optimizer;
  double wall_s = 0;
  int look_at = 0;  ///< generation to see at whether it may end, where the first law failed too often; else 0
};

/// The folder `state` inside a job's results: what is needed to go on to the same bits after an interruption. Every
/// file is complete or absent; readers throw traceur::Error that names the file.
class JobFolder {
public:
  explicit JobFolder(const std::filesystem::path& out) : folder_(out / "state") {}

  /// Forgets an older job and notes what this one is: its arguments and a digest of its inputs.
  void begin(const nlohmann::ordered_json& arguments, const std::string& digest) const;
  nlohmann::ordered_json read_job() const;
  /// Throws unless the job was begun with inputs of this digest and with this version.
  void check(const std::string& digest) const;

  void save(const std::string& name, const SavedSearch& search) const;
  void save(const SavedLearning& learning) const;
  std::optional<SavedSearch> load_search(const std::string& name) const;
  std::optional<SavedLearning> load_learning() const;

private:
  nlohmann::ordered_json read(const std::filesystem::path& path) const;
  std::filesystem::path folder_;
};

}  // namespace perform

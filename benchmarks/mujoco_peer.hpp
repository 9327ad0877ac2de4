// SPDX-License-Identifier: MIT
#pragma once

#include <memory>
#include <stdexcept>

#include <mujoco/mujoco.h>

#include "humanoid.hpp"
#include <traceur/core/random.hpp>

/// MuJoCo's humanoid in its neutral pose, with random velocities.
class MujocoPeer {
 public:
  MujocoPeer() {
    char error[256] = "";
    model_.reset(mj_loadXML(humanoid_file().c_str(), nullptr, error, sizeof error));
    if (!model_) throw std::runtime_error(error);
    data_.reset(mj_makeData(model_.get()));
    traceur::core::RandomStream random(1);
    for (int k = 0; k < model_->nv; ++k) data_->qvel[k] = random.normal();
  }
  mjModel* model() { return model_.get(); }
  mjData* data() { return data_.get(); }

 private:
  struct Free {
    void operator()(mjModel* m) const { mj_deleteModel(m); }
    void operator()(mjData* d) const { mj_deleteData(d); }
  };
  std::unique_ptr<mjModel, Free> model_;
  std::unique_ptr<mjData, Free> data_;
};

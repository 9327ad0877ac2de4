// SPDX-License-Identifier: MIT
//
// A simulated character performs a motion clip.
//
//   clip ─ retarget ─ reference ─ open loop ─ feedback ─ test ─ replay
//                                 (motor      (a linear  (unseen
//                                 targets,    law, by    starts,
//                                 sampling)   CMA-ES)    pushes)
//
// Open loop: targets for the joints' motors are found window by window by simulating thousands of samples (Liu et al.
// 2010). They make the motion once, from one state. Feedback: a law of a few dozen numbers turns what the character
// senses into small changes of the targets, so that the motion survives other starts and pushes (Ding et al. 2012).
#include "options.hpp"
#include "performer.hpp"
#include "preparation.hpp"
#include "../common/command_line.hpp"
#include "../common/progress.hpp"
#include "results.hpp"
#include "traceur/core/error.hpp"
#include "traceur/io/controller_file.hpp"

namespace {

using namespace perform;
using namespace example;
using traceur::control::TrackingReference;

void test_and_show(const Options& options, const Scene& scene, Learned learned, const TrackingReference& measured,
                   Performer& performer, Report& report) {
  const bool is_new_gait = options.controller.empty() && learned.controller.cyclic;
  const bool robust = options.robust.value_or(is_new_gait && !options.quick);
  if (robust) {
    const Learned hardened = performer.harden(learned.controller);
    report.add_hardening(hardened);
    learned.controller.law = hardened.controller.law;
  }
  if (options.fine_tune_s > 0) {
    const Learned tuned = performer.fine_tune(learned.controller, options.fine_tune_s);
    report.add_fine_tuning(tuned);
    learned.controller.law = tuned.controller.law;
  }
  if (robust || options.fine_tune_s > 0)
    traceur::io::write_controller(options.out / "controller.json", learned.controller);
  report.add(performer.test(learned.controller, measured), learned);
  const PushResult pushes = performer.push(learned.controller);
  report.add(pushes);
  const Recording recording = performer.record(learned.controller, 0.5 * pushes.tolerance_Ns[2]);
  report.add(recording);
  write_recording(options, scene, recording, report);
}

/// Teaches the scene's character the prepared motion.
void learn(const Options& options, const Scene& scene, const Preparation& preparation, Performer& performer,
           Report& report) {
  const Motion &whole = preparation.motions.front(), &learnt = preparation.motions.back();
  const SavedSearch open_loop = performer.search(whole);
  report.add(performer.judge(whole, open_loop));
  if (options.open_loop) {
    write_open_loop(options, scene, whole, open_loop);
    return;
  }
  const SavedSearch targets = &whole == &learnt ? open_loop : performer.search(learnt);
  const Learned learned = performer.learn(learnt, targets);

  write_open_loop(options, scene, whole, open_loop);
  traceur::io::write_controller(options.out / "controller.json", learned.controller);
  test_and_show(options, scene, learned, learnt.measured, performer, report);
}

/// Everything after the inputs are known to be good.
template <class Work>
int carry_out(const Options& options, Report& report, Work&& work) {
  const Clock clock;
  const Ending ending = ending_of("perform --resume " + options.out.string(), work);
  return report.write(clock.seconds(), ending);
}

int run(const Options& options) {
  listen_for_interruption();
  Effort effort = Effort::of(options.quick);
  if (options.simulator != "bundled") effort = effort.on_engine(options.quick);
  Scene scene = load_scene(options);
  Preparation preparation;
  if (!options.clip.empty()) preparation = prepare(options, effort, scene);
  Learned given;
  if (!options.controller.empty()) {
    given.controller = traceur::io::read_controller(options.controller, scene.model, scene.roles);
    std::printf("controller: %s, %s\n", given.controller.clip.c_str(),
                given.controller.cyclic ? "cyclic" : "done once");
  }
  Report report(options, scene);
  if (!options.clip.empty()) report.add(preparation);
  Performer performer(scene, options, effort);

  if (!options.controller.empty()) {
    const TrackingReference* measured = &given.controller.reference;
    if (!options.clip.empty() && preparation.motions.back().cyclic == given.controller.cyclic &&
        preparation.motions.back().measured.ticks >= given.controller.ticks())
      measured = &preparation.motions.back().measured;
    return carry_out(options, report, [&] { test_and_show(options, scene, given, *measured, performer, report); });
  }
  const JobFolder folder(options.out);
  if (options.resume)
    folder.check(digest(scene, preparation));
  else
    folder.begin(job_arguments(options), digest(scene, preparation));
  return carry_out(options, report, [&] { learn(options, scene, preparation, performer, report); });
}

}  // namespace

int main(int argc, char** argv) { return example::main_of("perform", argc, argv, perform::read_options, run); }

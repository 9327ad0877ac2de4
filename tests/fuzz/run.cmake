# Runs a fuzz target for a while on a copy of its seeds, so that what it finds stays in the build folder.
# Expects PROGRAM, SEEDS (a folder, which may be absent), WORK (a folder) and SECONDS.
if(DEFINED ENV{TRACEUR_FUZZ_SECONDS})
  set(SECONDS $ENV{TRACEUR_FUZZ_SECONDS})
endif()
file(MAKE_DIRECTORY ${WORK}/corpus)
if(EXISTS ${SEEDS})
  file(COPY ${SEEDS}/ DESTINATION ${WORK}/corpus)
endif()
execute_process(COMMAND ${PROGRAM} -max_total_time=${SECONDS} -artifact_prefix=${WORK}/ ${WORK}/corpus
  RESULT_VARIABLE result)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "${PROGRAM} failed (${result}); the input is in ${WORK}")
endif()

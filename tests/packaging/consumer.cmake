# The consumer's program, the same however it came by traceur.
add_executable(consumer ${CMAKE_CURRENT_LIST_DIR}/main.cpp)
target_compile_definitions(consumer PRIVATE TRACEUR_EXPECTED_VERSION="${TRACEUR_EXPECTED_VERSION}")
target_link_libraries(consumer PRIVATE traceur::traceur)

# A component that is here must link from here, with all that it drags in.
foreach(component io ceres nlopt mujoco bullet ode dart)
  if(TARGET traceur::${component})
    target_link_libraries(consumer PRIVATE traceur::${component})
  endif()
endforeach()

# The library imposes an include directory, a language level and its dependencies, but no flags.
get_target_property(flags traceur::traceur INTERFACE_COMPILE_OPTIONS)
if(flags)
  message(FATAL_ERROR "traceur::traceur imposes compile options: ${flags}")
endif()

# Helpers for traceur's own programs: its tests, benchmarks and examples.

set(TRACEUR_INCLUDE_DIR ${CMAKE_CURRENT_LIST_DIR}/../include)
cmake_path(NORMAL_PATH TRACEUR_INCLUDE_DIR)

# Third-party includes and the component each belongs to. Of two expressions that match, the first counts.
set(TRACEUR_INCLUDE_OWNERS
  "pugixml" io "nlohmann/" io "ceres/" ceres "nlopt" nlopt "mujoco/" mujoco
  "dart/" dart "ode/" ode "btBullet|bullet/" bullet "CLI/" cli11 "benchmark/" benchmark)

# traceur_headers(<variable>) lists every public header, relative to include/. Headers in a detail folder are not public.
function(traceur_headers variable)
  set(configure_depends CONFIGURE_DEPENDS)
  if(CMAKE_SCRIPT_MODE_FILE)
    set(configure_depends)
  endif()
  file(GLOB_RECURSE headers RELATIVE ${TRACEUR_INCLUDE_DIR} ${configure_depends} ${TRACEUR_INCLUDE_DIR}/traceur/*.hpp)
  list(FILTER headers EXCLUDE REGEX "/detail/")
  set(${variable} ${headers} PARENT_SCOPE)
endfunction()

# traceur_requirements(<variable> <file>...) lists the components behind what the files and the traceur headers they
# include, directly or not, take from third parties. Eigen is everyone's and not listed.
function(traceur_requirements variable)
  set(pending ${ARGN})
  set(seen)
  set(components)
  while(pending)
    list(POP_FRONT pending file)
    if(file IN_LIST seen)
      continue()
    endif()
    list(APPEND seen ${file})
    cmake_path(GET file PARENT_PATH folder)
    file(STRINGS ${file} lines REGEX "^[ \t]*#[ \t]*include[ \t]*[<\"]")
    foreach(line IN LISTS lines)
      string(REGEX REPLACE "^[^<\"]*[<\"]([^>\"]*)[>\"].*" "\\1" name "${line}")
      if(NOT line MATCHES "<" AND EXISTS ${folder}/${name})
        cmake_path(ABSOLUTE_PATH name BASE_DIRECTORY ${folder} NORMALIZE OUTPUT_VARIABLE path)
        list(APPEND pending ${path})
      elseif(EXISTS ${TRACEUR_INCLUDE_DIR}/${name})
        list(APPEND pending ${TRACEUR_INCLUDE_DIR}/${name})
      else()
        set(owners ${TRACEUR_INCLUDE_OWNERS})
        while(owners)
          list(POP_FRONT owners expression component)
          if(name MATCHES "^(${expression})")
            list(APPEND components ${component})
            break()
          endif()
        endwhile()
      endif()
    endforeach()
  endwhile()
  list(REMOVE_DUPLICATES components)
  set(${variable} ${components} PARENT_SCOPE)
endfunction()

# traceur_missing(<variable> <file>...) lists those of the files' components that this build does not have.
function(traceur_missing variable)
  traceur_requirements(required ${ARGN})
  set(missing)
  foreach(component IN LISTS required)
    if(component STREQUAL "cli11")
      set(target CLI11::CLI11)
    elseif(component STREQUAL "benchmark")
      set(target benchmark::benchmark)
    else()
      set(target traceur::${component})
    endif()
    if(NOT TARGET ${target})
      list(APPEND missing ${component})
    endif()
  endforeach()
  set(${variable} ${missing} PARENT_SCOPE)
endfunction()

# traceur_available(<variable> <file>...) keeps the files that can be compiled here and says which are left out.
function(traceur_available variable)
  set(kept)
  foreach(file IN LISTS ARGN)
    traceur_missing(missing ${file})
    if(missing)
      message(STATUS "left out without ${missing}: ${file}")
    else()
      list(APPEND kept ${file})
    endif()
  endforeach()
  set(${variable} ${kept} PARENT_SCOPE)
endfunction()

# traceur_own(<target>) gives one of traceur's own targets its warnings, the machine's instructions, and every component
# that was found.
function(traceur_own target)
  # g++ 12 sees uninitialised registers inside its own AVX-512 intrinsics.
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wconversion -Wshadow
    $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>
    $<$<BOOL:${TRACEUR_WERROR}>:-Werror> $<$<BOOL:${TRACEUR_NATIVE}>:-march=native>)
  set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF)
  target_link_libraries(${target} PRIVATE traceur::traceur)
  foreach(library traceur::io traceur::ceres traceur::nlopt traceur::mujoco CLI11::CLI11)
    if(TARGET ${library})
      target_link_libraries(${target} PRIVATE ${library})
    endif()
  endforeach()
endfunction()

# traceur_add_executable(<name> <source>...) adds one of traceur's own programs, to be found in <build>/bin.
function(traceur_add_executable name)
  add_executable(${name} ${ARGN})
  traceur_own(${name})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
endfunction()

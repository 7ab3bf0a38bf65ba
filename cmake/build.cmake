# How this tree is built when it is itself the project, and what it refuses however it is built.
string(TOUPPER "${CMAKE_BUILD_TYPE}" build_type)
foreach(flags "${CMAKE_CXX_FLAGS}" "${CMAKE_CXX_FLAGS_${build_type}}")
  if(flags MATCHES "(^| )(-ffast-math|-Ofast|-funsafe-math-optimizations|-fassociative-math|-freciprocal-math|-ffinite-math-only)( |$)")
    message(FATAL_ERROR
      "${CMAKE_MATCH_2} lets the compiler change the rounding that kfstab is there to measure. Take it out of the flags: ${flags}")
  endif()
endforeach()

# Each room finds what it needs; whoever links to the room (a test, the next room) must know those targets as well.
set(CMAKE_FIND_PACKAGE_TARGETS_GLOBAL ON)

if(PROJECT_IS_TOP_LEVEL)
  if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
    set(CMAKE_BUILD_TYPE Release)
  endif()
  set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
  # Memory is plenty: g++ looks for what it no longer needs from 400 MB on, and not from 128. A tenth of its time.
  add_compile_options($<$<COMPILE_LANG_AND_ID:CXX,GNU>:--param=ggc-min-heapsize=400000>)
  # CCACHE_DISABLE=1 in the environment compiles in earnest.
  find_program(KFSTAB_CCACHE ccache)
  if(KFSTAB_CCACHE AND NOT DEFINED CMAKE_CXX_COMPILER_LAUNCHER)
    # Precompiled headers are looked up in the cache only if ccache may trust that what they were made from is unchanged,
    # which Ninja sees to.
    set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros CCACHE_DEPEND=1
        ${KFSTAB_CCACHE})
    if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
      add_compile_options(-fpch-preprocess)
    endif()
  endif()
endif()

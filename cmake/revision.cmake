# The revision that is being built, for whoever includes <kfstab_revision.hpp> (KFSTAB_REVISION, a string literal).
#
# Included, this defines the target kfstab_revision to link to. Run as a script, at every build, it asks git and rewrites
# the header if the answer has changed, so that a commit compiles one source and no configuring is needed.
if(NOT CMAKE_SCRIPT_MODE_FILE)
  include_guard(GLOBAL)
  set(header ${PROJECT_BINARY_DIR}/include/revision/kfstab_revision.hpp)
  add_custom_target(kfstab_find_revision
    COMMAND ${CMAKE_COMMAND} -DSOURCE=${PROJECT_SOURCE_DIR} -DHEADER=${header} -P ${CMAKE_CURRENT_LIST_FILE}
    BYPRODUCTS ${header} COMMENT "Finding the revision" VERBATIM)
  add_library(kfstab_revision INTERFACE)
  target_include_directories(kfstab_revision INTERFACE ${PROJECT_BINARY_DIR}/include/revision)
  add_dependencies(kfstab_revision kfstab_find_revision)
  return()
endif()

set(revision unknown)
find_program(git git)
if(git AND EXISTS ${SOURCE}/.git) # not some other repository around an unpacked archive
  execute_process(
    # The tree may be somebody else's: git takes the word of the command line for it that this is safe.
    COMMAND ${git} --no-optional-locks -c safe.directory=* describe --always --dirty --abbrev=12 --exclude=*
    WORKING_DIRECTORY ${SOURCE} OUTPUT_VARIABLE answer ERROR_QUIET RESULT_VARIABLE result OUTPUT_STRIP_TRAILING_WHITESPACE)
  if(result EQUAL 0 AND answer MATCHES "^[0-9a-f]+(-dirty)?$")
    set(revision ${answer})
  endif()
endif()
file(CONFIGURE OUTPUT ${HEADER} @ONLY CONTENT [[// Written by cmake/revision.cmake at every build.
#pragma once
#define KFSTAB_REVISION "@revision@"
]])

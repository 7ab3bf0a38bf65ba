# One room, one target: kfstab_room(filters DEPENDS Eigen3::Eigen PRIVATE ...).
#
# A room's headers are seen as <kfstab/ROOM/NAME.hpp> and only by the targets that link to the room:
# build/include/ROOM is the include root of that target alone, and build/include/ROOM/kfstab/ROOM links to the
# room's folder. So an include that points against the arrows does not build. Sources in the room's folder are
# part of its target by being there.
function(kfstab_room room)
  cmake_parse_arguments(arg "" "OPTIMIZE" "DEPENDS;PRIVATE;SOURCES;PRECOMPILE" ${ARGN})
  set(root ${PROJECT_BINARY_DIR}/include/${room})
  file(MAKE_DIRECTORY ${root}/kfstab)
  file(CREATE_LINK ${CMAKE_CURRENT_SOURCE_DIR} ${root}/kfstab/${room} SYMBOLIC)

  file(GLOB headers CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} *.hpp)
  file(GLOB tables CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} *.inc)
  list(TRANSFORM headers PREPEND ${root}/kfstab/${room}/)
  list(TRANSFORM tables PREPEND ${root}/kfstab/${room}/)
  file(GLOB sources CONFIGURE_DEPENDS *.cpp)

  add_library(kfstab_${room} STATIC ${sources} ${arg_SOURCES})
  add_library(kfstab::${room} ALIAS kfstab_${room})
  target_sources(kfstab_${room} PUBLIC FILE_SET HEADERS BASE_DIRS ${root} FILES ${headers})
  if(tables)
    target_sources(kfstab_${room} PUBLIC FILE_SET tables TYPE HEADERS BASE_DIRS ${root} FILES ${tables})
  endif()
  target_compile_features(kfstab_${room} PUBLIC cxx_std_20)
  target_link_libraries(kfstab_${room} PUBLIC ${arg_DEPENDS} PRIVATE ${arg_PRIVATE} $<BUILD_INTERFACE:kfstab_warnings>)
  # What nearly every source of ours reads first, read once: a third of a clean build's time.
  if(PROJECT_IS_TOP_LEVEL AND arg_PRECOMPILE)
    target_precompile_headers(kfstab_${room} PRIVATE ${arg_PRECOMPILE})
  endif()
  # Compiling takes longer than running where the work is done by a room below: -Og halves the time of -O2 (measured in
  # pairs, the tool runs within 5 % of -O2 all the same). filters keeps the -O2 of the build type.
  if(arg_OPTIMIZE)
    target_compile_options(kfstab_${room} PRIVATE $<$<CONFIG:Release>:${arg_OPTIMIZE}>)
  endif()
  set_target_properties(kfstab_${room} PROPERTIES
    # Of a unity build: what sources have in common is read and instantiated once for sixteen, not for eight.
    UNITY_BUILD_BATCH_SIZE 16
    EXPORT_NAME ${room} OUTPUT_NAME kfstab_${room} POSITION_INDEPENDENT_CODE ON
    # A table (.inc) means nothing by itself; every header must.
    VERIFY_INTERFACE_HEADER_SETS ON INTERFACE_HEADER_SETS_TO_VERIFY HEADERS)
endfunction()

# Warnings are ours, not our users': linked privately, never exported.
add_library(kfstab_warnings INTERFACE)
target_compile_options(kfstab_warnings INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion
  $<$<BOOL:${KFSTAB_WARNINGS_AS_ERRORS}>:-Werror>)

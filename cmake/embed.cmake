# Turns text files into a C++ source that defines one array of {name, text}:
#   kfstab_embed(OUTPUT x.cpp HEADER <kfstab/..> NAMESPACE ns ENTRY Type FUNCTION name FILES a.toml b.toml)
# Strings are cut into pieces, as compilers limit the length of one literal.
function(kfstab_embed)
  cmake_parse_arguments(arg "" "OUTPUT;HEADER;NAMESPACE;ENTRY;FUNCTION" "FILES" ${ARGN})
  set(entries "")
  foreach(file IN LISTS arg_FILES)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
    cmake_path(GET file STEM name)
    file(READ ${file} text)
    string(APPEND entries "    {\"${name}\", R\"kfstab(${text})kfstab\"},\n")
  endforeach()
  file(CONFIGURE OUTPUT ${arg_OUTPUT} @ONLY CONTENT "// Made by cmake/embed.cmake.
#include <${arg_HEADER}>

namespace ${arg_NAMESPACE} {
namespace {
constexpr ${arg_ENTRY} entries[] = {
${entries}};
}  // namespace
std::span<const ${arg_ENTRY}> ${arg_FUNCTION}() { return entries; }
}  // namespace ${arg_NAMESPACE}
")
endfunction()

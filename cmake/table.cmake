# The table of all claims (or laws): every FOLDER/NAME.cpp defines one function `Type ENTRY()` in namespace
# NS::FOLDER::NAME, and the generated source lists them all. Named calls, not objects that register themselves: a static
# library drops those.
#   kfstab_table(OUTPUT x.cpp HEADER kfstab/... NAMESPACE ns FOLDER claims TYPE Claim ENTRY claim FUNCTION all_claims
#                FILES ...)
function(kfstab_table)
  cmake_parse_arguments(arg "" "OUTPUT;HEADER;NAMESPACE;FOLDER;TYPE;ENTRY;FUNCTION" "FILES" ${ARGN})
  set(declarations "")
  set(calls "")
  foreach(file IN LISTS arg_FILES)
    cmake_path(GET file STEM name)
    string(APPEND declarations "namespace ${arg_FOLDER}::${name} { ${arg_TYPE} ${arg_ENTRY}(); }\n")
    string(APPEND calls "    ${arg_FOLDER}::${name}::${arg_ENTRY}(),\n")
  endforeach()
  file(CONFIGURE OUTPUT ${arg_OUTPUT} @ONLY CONTENT "// Made by cmake/table.cmake from the files in ${arg_FOLDER}/.
#include <${arg_HEADER}>

namespace ${arg_NAMESPACE} {
${declarations}
std::vector<${arg_TYPE}> ${arg_FUNCTION}() {
  return {
${calls}  };
}
}  // namespace ${arg_NAMESPACE}
")
endfunction()

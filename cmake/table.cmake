# The table of all claims (or laws): every FOLDER/NAME.cpp defines one function `Type NAME()` in namespace NS::FOLDER, and
# the generated source lists them all. Named calls, not objects that register themselves: a static library drops those.
#   kfstab_table(OUTPUT x.cpp HEADER kfstab/... NAMESPACE ns FOLDER claims TYPE Claim FUNCTION all_claims FILES ...)
function(kfstab_table)
  cmake_parse_arguments(arg "" "OUTPUT;HEADER;NAMESPACE;FOLDER;TYPE;FUNCTION" "FILES" ${ARGN})
  set(declarations "")
  set(calls "")
  foreach(file IN LISTS arg_FILES)
    cmake_path(GET file STEM name)
    string(APPEND declarations "${arg_TYPE} ${name}();\n")
    string(APPEND calls "    ${arg_FOLDER}::${name}(),\n")
  endforeach()
  file(CONFIGURE OUTPUT ${arg_OUTPUT} @ONLY CONTENT "// Made by cmake/table.cmake from the files in ${arg_FOLDER}/.
#include <${arg_HEADER}>

namespace ${arg_NAMESPACE} {
namespace ${arg_FOLDER} {
${declarations}}  // namespace ${arg_FOLDER}

std::vector<${arg_TYPE}> ${arg_FUNCTION}() {
  return {
${calls}  };
}
}  // namespace ${arg_NAMESPACE}
")
endfunction()

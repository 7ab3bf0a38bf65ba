# find_package(kfstab COMPONENTS filters) and the program. One set of exported targets a room, so that who asks for the
# filters needs Eigen and nothing else.
include(CMakePackageConfigHelpers)

set(destination ${CMAKE_INSTALL_LIBDIR}/cmake/kfstab)
foreach(room filters slicot reports reference properties check)
  if(TARGET kfstab_${room})
    get_target_property(header_sets kfstab_${room} INTERFACE_HEADER_SETS)
    if(NOT header_sets)  # an interface alone
      set(header_sets "")
    endif()
    list(TRANSFORM header_sets REPLACE "(.+)" "FILE_SET;\\1;COMPONENT;${room}")
    install(TARGETS kfstab_${room} EXPORT kfstab_${room} COMPONENT ${room} ${header_sets})
    install(EXPORT kfstab_${room} NAMESPACE kfstab:: FILE kfstab_${room}.cmake DESTINATION ${destination}
            COMPONENT ${room})
  endif()
endforeach()
if(TARGET kfstab_tool)
  install(TARGETS kfstab_tool COMPONENT tool)
endif()

configure_package_config_file(cmake/kfstabConfig.cmake.in ${PROJECT_BINARY_DIR}/kfstabConfig.cmake
                              INSTALL_DESTINATION ${destination} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/kfstabConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/kfstabConfig.cmake ${PROJECT_BINARY_DIR}/kfstabConfigVersion.cmake
        DESTINATION ${destination} COMPONENT filters)

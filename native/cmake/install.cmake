# For find_package(pointmorph) elsewhere: cmake --install BUILD --prefix PREFIX --component cpp
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

set(config_folder ${CMAKE_INSTALL_LIBDIR}/cmake/pointmorph)
if(SKBUILD)
  set(unless_asked EXCLUDE_FROM_ALL)  # a wheel has none of it
endif()
set_target_properties(pointmorph_core PROPERTIES EXPORT_NAME pointmorph)
install(TARGETS pointmorph_core EXPORT pointmorph
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT cpp ${unless_asked})
install(DIRECTORY native/include/pointmorph DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
  COMPONENT cpp ${unless_asked})
install(EXPORT pointmorph NAMESPACE pointmorph:: FILE pointmorphTargets.cmake
  DESTINATION ${config_folder} COMPONENT cpp ${unless_asked})
configure_package_config_file(native/cmake/pointmorphConfig.cmake.in
  ${CMAKE_CURRENT_BINARY_DIR}/pointmorphConfig.cmake INSTALL_DESTINATION ${config_folder})
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/pointmorphConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/pointmorphConfig.cmake
  ${CMAKE_CURRENT_BINARY_DIR}/pointmorphConfigVersion.cmake
  DESTINATION ${config_folder} COMPONENT cpp ${unless_asked})

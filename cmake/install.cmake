# cmake --install: the program, the libraries and their headers; find_package(isoskin) finds isoskin::core,
# isoskin::kernels and isoskin::render.
include(CMakePackageConfigHelpers)

install(TARGETS isoskin_core isoskin_kernels isoskin_render isoskin_flags EXPORT isoskin_targets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(TARGETS isoskin RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
foreach(room core kernels render)
  install(DIRECTORY ${room} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/isoskin FILES_MATCHING PATTERN "*.h")
endforeach()
install(EXPORT isoskin_targets NAMESPACE isoskin:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/isoskin)
install(FILES cmake/dependencies.cmake DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/isoskin)
configure_package_config_file(cmake/isoskin-config.cmake.in ${PROJECT_BINARY_DIR}/isoskin-config.cmake
  INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/isoskin)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/isoskin-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/isoskin-config.cmake ${PROJECT_BINARY_DIR}/isoskin-config-version.cmake
  DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/isoskin)

# Everything isoskin links, found in one place; the installed package finds the same.
list(APPEND CMAKE_MODULE_PATH /usr/lib/${CMAKE_LIBRARY_ARCHITECTURE}/cmake/OpenVDB)

find_package(Threads REQUIRED)
if(ISOSKIN_PEERS)  # before TBB: VTK finds it its own way
  find_package(VTK REQUIRED COMPONENTS CommonCore CommonDataModel FiltersCore)
  find_package(CGAL REQUIRED)
endif()
find_package(TBB REQUIRED)
find_package(OpenVDB REQUIRED COMPONENTS openvdb)
find_package(OpenCL REQUIRED)
find_package(embree 3 REQUIRED)
find_package(PNG REQUIRED)
find_package(Qhull REQUIRED)
find_package(fmt REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(tomlplusplus REQUIRED)
find_package(CLI11 REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(epoxy REQUIRED IMPORTED_TARGET epoxy)
pkg_check_modules(egl REQUIRED IMPORTED_TARGET egl)
pkg_check_modules(openexr REQUIRED IMPORTED_TARGET OpenEXR)  # Debian 12's Imath package, which its CMake file asks for, is broken

# The Debian package that `./dev package` builds.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME tribode)
set(CPACK_PACKAGE_CONTACT "Tribode maintainers <maintainers@localhost>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION "Hybrid simulation of servo axes with friction and of other systems with events,
frequency responses measured as on a real machine, diagnosis of what a model
lacks. Contains the program, the ready scripts and models, and the C++ library.")
# The libraries that the program is linked with are found from the program itself; plots are drawn by gnuplot.
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "gnuplot-nox | gnuplot, fonts-dejavu-core")
# What programs of others need to link the library.
string(CONCAT CPACK_DEBIAN_PACKAGE_SUGGESTS "cmake, pkg-config, libsundials-dev, libsuitesparse-dev, libeigen3-dev, "
       "liblua5.4-dev, libfmt-dev, nlohmann-json3-dev, libhdf5-dev, zlib1g-dev, libssl-dev, libpugixml-dev, libzip-dev, gcc")
include(CPack)

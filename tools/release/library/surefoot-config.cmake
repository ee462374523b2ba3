# Defines the targets surefoot::surefoot, which is the shared library, and surefoot::static.
get_filename_component(_surefoot_root "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET surefoot::surefoot)
    add_library(surefoot::surefoot SHARED IMPORTED)
    set_target_properties(surefoot::surefoot PROPERTIES
        IMPORTED_LOCATION "${_surefoot_root}/lib/libsurefoot.so"
        IMPORTED_NO_SONAME TRUE
        INTERFACE_INCLUDE_DIRECTORIES "${_surefoot_root}/include")
    add_library(surefoot::static STATIC IMPORTED)
    set_target_properties(surefoot::static PROPERTIES
        IMPORTED_LOCATION "${_surefoot_root}/lib/libsurefoot.a"
        INTERFACE_INCLUDE_DIRECTORIES "${_surefoot_root}/include"
        INTERFACE_LINK_LIBRARIES "pthread;dl;m;gcc_s;c")
endif()
unset(_surefoot_root)

// The C++ library's headers are those of the host's compiler, which ask for glibc's version.
#pragma once
#define __GLIBC_PREREQ(major, minor) 0

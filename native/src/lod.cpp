#include "pointmorph/lod.hpp"

#include "pointmorph/path.hpp"

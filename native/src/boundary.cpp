#include "pointmorph/boundary.hpp"

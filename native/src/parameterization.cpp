#include "pointmorph/parameterization.hpp"

#include "pointmorph/covariance.hpp"

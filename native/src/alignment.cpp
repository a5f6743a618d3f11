#include "pointmorph/alignment.hpp"

#include "pointmorph/morph.hpp"

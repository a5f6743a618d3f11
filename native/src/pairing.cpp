#include "pointmorph/pairing.hpp"

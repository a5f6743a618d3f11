#include "pointmorph/transfer.hpp"

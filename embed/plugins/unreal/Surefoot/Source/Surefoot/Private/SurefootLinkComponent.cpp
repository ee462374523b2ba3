#include "SurefootLinkComponent.h"

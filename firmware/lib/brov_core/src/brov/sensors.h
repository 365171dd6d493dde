// The readers of the small sensors: bytes in, newest readings out. docs/firmware-core.md section 6.
#pragma once

#include "brov/derived.h"
#include "brov/ezo_ec.h"
#include "brov/ms5837.h"
#include "brov/nmea.h"
#include "brov/tsys01.h"
#include "brov/witmotion.h"

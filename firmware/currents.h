/* What part of its chip's current each LED may carry, 255 is all: parts.csv says why. */
#ifndef CURRENTS_H
#define CURRENTS_H

#include <avr/pgmspace.h>

static const uint8_t most_current[N_LED] PROGMEM = {[0 ... N_LED - 1] = 255};

#endif

/* Why the program started, and the watchdog that may make it start anew. */
#ifndef RESET_H
#define RESET_H

#include <stdint.h>

enum reset { RESET_POWER, RESET_BUTTON, RESET_HANG, RESET_SUPPLY };

extern uint8_t reset_flags; /* MCUSR; 0 where a bootloader has cleared it */
extern volatile uint8_t reset_uncalmed_ms;

enum reset reset_cause(void); /* at the start, once */
void reset_watch(void);       /* if all is well the watchdog may wait anew */
void reset_low_supply(void);  /* the supply is failing */

#endif

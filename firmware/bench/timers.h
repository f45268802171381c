/* The pins of the simulated ring, with the compare outputs of timers 1 and 2 as the data sheet has them. */
#ifndef TIMERS_H
#define TIMERS_H

#include <simavr/sim_avr.h>

enum signal { DATA_EVEN, DATA_ODD, CLOCK, LATCH, OE_EVEN, OE_ODD, ROUND, SLOT, LIGHT, N_SIGNAL };

extern const char *const signal_name[N_SIGNAL];

/* Take over timers 1 and 2; call `changed` with the time whenever a pin of the ring changes. */
void timers_attach(avr_t *avr, void (*changed)(avr_cycle_count_t when, enum signal signal, int value));

int timers_level(enum signal signal);

/* What feeds the chip, and the shift registers with their LEDs [mV]. */
void timers_supply(avr_t *avr, int chip_mv, int leds_mv);

#endif

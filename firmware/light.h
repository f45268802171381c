/* The ring's light: slots, crossfades, triggers. All edges are made by timer hardware. */
#ifndef LIGHT_H
#define LIGHT_H

#include <stdbool.h>
#include <stdint.h>

#ifndef N_LED
#define N_LED 24 /* even, 48 at most: make LEDS=48 */
#endif
#define NONE 0xFF /* no LED */
#define MAX_SLOTS 256
#define MIN_SLOT_US 200UL
#define MAX_SLOT_US 1000000UL
#define MAX_ON_US 2000000UL /* an LED is lit no longer in a row */
#define MAX_ROUNDS 999999999UL
#define ALIVE_MS 40 /* without a valid line for so long all goes dark, unless the host asks for */
#define MIN_ALIVE_MS 10
#define MAX_ALIVE_MS 49 /* and a tick: dark within 50 */

/* Why the last run ended. */
enum cause { CAUSE_NONE, CAUSE_DONE, CAUSE_STOP, CAUSE_ALIVE, CAUSE_LIMIT, CAUSE_LATE, CAUSE_SUPPLY };

struct settings {
    uint8_t order[MAX_SLOTS]; /* LED of each slot, or NONE */
    uint16_t n_slot;
    uint8_t trim[N_LED]; /* of what currents.h allows, 255 is all */
    uint32_t slot_us;
    uint16_t n_period;  /* carrier periods in a slot; the first is longer by */
    uint8_t extra;      /* cycles */
    uint16_t n_fade;    /* of these periods, the last ones fade */
    uint32_t fade_rate; /* 2^32 / cycles of the fade */
    uint32_t rounds;    /* 0: until stopped */
    bool sync;          /* an edge per slot */
    uint8_t alive_ms;
};

extern struct settings settings; /* not to be written during a run */

void light_init(void);
void light_slot(uint32_t slot_us, uint32_t fade_ppm);
bool light_order_fades(void); /* false: neighbours of one chain, which can't fade into each other */
void light_start(void);
void light_dark(enum cause cause); /* at once; from anywhere */
void light_constant(bool on);
void light_alive(void); /* the host has spoken */
void light_off(enum cause cause); /* the ring and the constant light */
bool light_is_running(void);
bool light_is_constant(void);
enum cause light_cause(void);
uint32_t light_rounds_done(void);
bool light_is_well(void); /* a millisecond has passed, and the carrier too if it should */

#endif

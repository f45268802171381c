/* What is wired to which pin; README.md has the table and the drawing. */
#ifndef PINS_H
#define PINS_H

#include <avr/io.h>

#define OE_EVEN _BV(PB1) /* D9, OC1A: output enable of the even chain, low lets it shine; pull-up */
#define OE_ODD _BV(PB2)  /* D10, OC1B: the odd chain's */
#define ROUND _BV(PB3)   /* D11, OC2A: rising edge at each round start */
#define SLOT _BV(PD3)    /* D3, OC2B: rising edge at each slot start, on request */
#define LIGHT _BV(PD4)   /* D4: constant light, high is on; pull-down */

#define DATA_EVEN _BV(PC0) /* A0 */
#define DATA_ODD _BV(PC1)  /* A1 */
#define CLOCK _BV(PC2)     /* A2, both chains */
#define LATCH _BV(PC3)     /* A3, both chains */

#endif

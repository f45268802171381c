/* Watches the supply with the converter: how large the chip's own 1.1 V are, seen against it. */
#include "supply.h"

#include <avr/io.h>

#define BANDGAP_MV 1100UL /* 1000 to 1200, ATmega328P data sheet, bandgap reference */
#define LOW_MV 4000UL     /* 16 MHz want 3.8 V; USB gives 4.4 V at worst */
#define BANDGAP 14        /* channel */

void supply_init(void) {
    ADMUX = _BV(REFS0) | BANDGAP; /* against AVcc */
    ADCSRB = 0;
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADATE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0); /* over and over */
}

bool supply_is_low(void) { return ADC > BANDGAP_MV * 1024 / LOW_MV; }

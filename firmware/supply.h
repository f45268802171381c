/* The supply: 5 V feed the chip, the shift registers and the LEDs alike. */
#ifndef SUPPLY_H
#define SUPPLY_H

#include <stdbool.h>

void supply_init(void);
bool supply_is_low(void); /* below 4.0 V, 3.6 to 4.4 V from chip to chip */

#endif

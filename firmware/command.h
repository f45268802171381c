/* What the host may ask for; README.md documents the protocol. */
#ifndef COMMAND_H
#define COMMAND_H

#include "reset.h"

#define PROTOCOL 1
#define FIRMWARE "evsdr-ring-1.1"

void command_boot(enum reset cause); /* tell that the ring has started */
void command_poll(void);                /* answer the next line, if one has come */

#endif

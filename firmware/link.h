/* Lines over the UART: assembled, checked, answered. */
#ifndef LINK_H
#define LINK_H

#include <avr/pgmspace.h>
#include <stdbool.h>
#include <stdint.h>

#define BAUD 500000UL
#define MAX_LINE 128 /* characters of a line without its end */

enum received { NOTHING, LINE, BAD_CHECKSUM, TOO_LONG };

void link_init(void);
bool link_is_idle(void);            /* no byte waits */
enum received link_read(char **text); /* the next line, without checksum, valid until the next call */
uint16_t link_checksum(void);       /* that of the line last read */

void link_put(char c);
void link_text(const char *text);       /* in RAM */
void link_words(const char *flash_text); /* a PSTR */
void link_number(uint32_t number);
void link_end(void); /* checksum and end of line */

#endif

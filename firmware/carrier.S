/* What happens in every period of the carrier: 16 us, of which this takes 8 at most.
 *
 * What is written to the compare registers holds from the start of the next period. TOP holds at once; it
 * is never written below the counter, since the period that is longer is the first of a slot.
 *
 * In a fade, both compare values move on. A countdown tells when there is more to do. What can't wait is
 * done here: in the last period of a slot the first compare values of the next one and its triggers, in its
 * first period the latches, its length and the second compare values. The rest is the business of light.c,
 * at a vector that nothing else uses.
 */
#include <avr/io.h>

#define LATCH 3 /* of PORTC, see pins.h */

.macro copy16 from, low, high
    lds r25, \from + 1
    lds r24, \from
    sts \high, r25
    sts \low, r24
.endm

.macro move chain, low, high
    .irp byte, 0, 1, 2, 3
    lds r24, carrier_lit + 4 * \chain + \byte
    lds r25, carrier_step + 4 * \chain + \byte
    .if \byte
    adc r24, r25
    .else
    add r24, r25
    .endif
    sts carrier_lit + 4 * \chain + \byte, r24
    .endr
    com r24 /* TOP - lit cycles */
    ldi r25, 0
    sts \high, r25
    sts \low, r24
.endm

.global TIMER1_OVF_vect
TIMER1_OVF_vect:
    push r24
    in r24, _SFR_IO_ADDR(SREG)
    push r24
    push r25
    lds r24, carrier_fades
    sbrs r24, 0
    rjmp 1f
    move 0, OCR1AL, OCR1AH
    move 1, OCR1BL, OCR1BH
1:  lds r24, carrier_left
    lds r25, carrier_left + 1
    sbiw r24, 1
    sts carrier_left + 1, r25
    sts carrier_left, r24
    breq more
    pop r25
    pop r24
    out _SFR_IO_ADDR(SREG), r24
    pop r24
    reti

more:
    lds r24, carrier_event
    sbrc r24, 0 /* EVENT_LAST */
    rjmp last
    sbrc r24, 1 /* EVENT_FIRST */
    rjmp first
    sbrc r24, 2 /* EVENT_SECOND */
    rjmp second
    rjmp rest
last:
    copy16 carrier_first, OCR1AL, OCR1AH
    copy16 carrier_first + 2, OCR1BL, OCR1BH
    lds r24, carrier_edges
    sts TCCR2A, r24
    rjmp rest
first:
    sbi _SFR_IO_ADDR(PORTC), LATCH
    cbi _SFR_IO_ADDR(PORTC), LATCH
    copy16 carrier_top, ICR1L, ICR1H
    copy16 carrier_second, OCR1AL, OCR1AH
    copy16 carrier_second + 2, OCR1BL, OCR1BH
    rjmp rest
second:
    ldi r25, 0
    ldi r24, 255
    sts ICR1H, r25
    sts ICR1L, r24
rest:
    pop r25
    pop r24
    out _SFR_IO_ADDR(SREG), r24
    pop r24
    jmp SPM_READY_vect

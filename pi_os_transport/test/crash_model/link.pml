/* Ring, tickets and slots of a link in shared memory, and a crash at each of its steps.
 *
 * One publisher, LINKS subscribers. Each STEP is a place that is marked in the code under the same name
 * (src/shm/step_mark.h); there a process may die, as long as CRASHES are left. A subscriber that died comes back LIVES
 * times. What spin's search must not find:
 *   - a slot that is lost for ever: the publisher would wait for it, or its last assertion fails;
 *   - a slot that is written while it is read, or a message that is damaged, doubled or out of order;
 *   - a message that was published and neither taken nor dropped, with the subscriber alive;
 *   - a process that lives and waits for ever.
 * Memory is sequentially consistent here: memory_model has the orders. MUTANT makes a mistake that must be found. */

#ifndef LINKS
#define LINKS 1
#endif
#ifndef MESSAGES
#define MESSAGES 3
#endif
#ifndef CRASHES
#define CRASHES 2
#endif
#ifndef LIVES
#define LIVES 2
#endif
#ifndef MUTANT
#define MUTANT 0
#endif
#define CAPACITY 2           /* places and tickets of a ring */
#define QUEUE 1              /* messages that wait before the oldest is dropped */
#define SLOTS (LINKS * CAPACITY)  /* so that one that is lost is missed */
#define NONE 255

mtype = { ABSENT, WANTED, OFFERED, PROVED };

typedef Ring {               /* shared */
  byte tail;
  byte head;
  bool armed;
  byte count;                /* release_count */
  bool released[CAPACITY];
  byte number[CAPACITY];     /* an entry: the message, */
  byte ticket[CAPACITY];
  byte slot[CAPACITY];
}

typedef Link {
  mtype state = ABSENT;
  bool bell;                 /* the doorbell has been rung */
  bool subscriber_gone;      /* the kernel has closed its end of the channel */
  bool publisher_gone;
  bool held[CAPACITY];       /* private to the publisher, by ticket */
  byte owner[CAPACITY];
  byte buffer[CAPACITY];
  byte seen;                 /* release_count at the last collect */
  byte reading = NONE;       /* slot that the subscriber reads now; known to nobody */
  byte settled;              /* messages taken or dropped; known to nobody */
}

Ring ring[LINKS];
Link link[LINKS];
byte references[SLOTS];
bool unused[SLOTS] = true;
byte content[SLOTS];
byte crashes;

#define STEP(name) if :: crashes < CRASHES -> crashes++; goto dead :: true fi

#include "publisher.pml"
#include "subscriber.pml"

init
{
  byte i;
  atomic {
    for (i : 0 .. LINKS - 1) {
      run Subscriber(i)
    }
  }
}

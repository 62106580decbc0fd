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

/* ---------------------------------------------------------------------------------------------------- the publisher */

inline free(f_slot)
{
  references[f_slot]--;
  if
  :: references[f_slot] == 0 ->
     STEP("free.reference");
     unused[f_slot] = true;
     STEP("free.slot")
  :: else
  fi
}

inline give(g_link, g_ticket)
{
  if
  :: link[g_link].buffer[g_ticket] != NONE ->
     slot = link[g_link].buffer[g_ticket];
     link[g_link].buffer[g_ticket] = NONE;
     free(slot)
  :: else
  fi
}

inline collect(c_link)
{
  if
  :: ring[c_link].count != link[c_link].seen ->
     atomic { link[c_link].seen = ring[c_link].count; head = ring[c_link].head };
     for (ticket : 0 .. CAPACITY - 1) {
       if
       :: link[c_link].held[ticket] && ring[c_link].released[ticket] && head > link[c_link].owner[ticket] ->
          STEP("collect.seen");
          ring[c_link].released[ticket] = false;
          STEP("collect.mark");
          link[c_link].held[ticket] = false;
          give(c_link, ticket)
       :: else
       fi
     }
  :: else
  fi
}

inline drop_oldest(d_link)
{
  head = ring[d_link].head;
  ticket = NONE;
  atomic {
    if
    :: head != ring[d_link].tail ->
       ticket = ring[d_link].ticket[head % CAPACITY]
    :: else
    fi
  };
  if
  :: ticket != NONE ->
     atomic {
       if
       :: ring[d_link].head == head -> ring[d_link].head++; link[d_link].settled++
       :: else -> ticket = NONE
       fi
     };
     if
     :: ticket != NONE ->
        STEP("drop.head");
        link[d_link].held[ticket] = false;
        give(d_link, ticket)
     :: else
     fi
  :: else
  fi
}

inline close(c_link)
{
  for (ticket : 0 .. CAPACITY - 1) {
    if
    :: link[c_link].held[ticket] ->
       link[c_link].held[ticket] = false;
#if MUTANT == 1              /* forgets what the dead subscriber held */
       link[c_link].buffer[ticket] = NONE
#else
       give(c_link, ticket)
#endif
    :: else
    fi
  };
  atomic { link[c_link].state = ABSENT; link[c_link].subscriber_gone = false }
}

inline offer(o_link)
{
  atomic {
    ring[o_link].tail = 0; ring[o_link].head = 0; ring[o_link].armed = false; ring[o_link].count = 0;
    for (ticket : 0 .. CAPACITY - 1) {
      ring[o_link].released[ticket] = false;
      link[o_link].buffer[ticket] = NONE
    };
    link[o_link].seen = 0; link[o_link].settled = 0; link[o_link].bell = false; ticket = 0;
    link[o_link].state = OFFERED
  };
  STEP("offer.sent")
}

/* What happens on the sockets. */
inline serve(s_link)
{
  if
  :: link[s_link].subscriber_gone -> close(s_link)
  :: else ->
     if
     :: link[s_link].state == WANTED -> offer(s_link)
     :: else
     fi
  fi
}

#define WORK(i) (link[i].subscriber_gone || (link[i].state == PROVED && ring[i].count != link[i].seen))
#if LINKS == 2
#define ANY_WORK (WORK(0) || WORK(1))
#else
#define ANY_WORK WORK(0)
#endif

inline reclaim()
{
  for (other : 0 .. LINKS - 1) {
    serve(other);
    if
    :: link[other].state == PROVED -> collect(other)
    :: else
    fi
  }
}

inline allocate()
{
  do
  :: fresh = 0;
     do
     :: fresh < SLOTS && !unused[fresh] -> fresh++
     :: else -> break
     od;
     if
     :: fresh < SLOTS -> break
     :: else -> ANY_WORK; reclaim()  /* a slot that is lost is waited for here for ever */
     fi
  od;
  unused[fresh] = false;
  STEP("allocate.slot");
  references[fresh] = 1;
  for (other : 0 .. LINKS - 1) {
    assert(link[other].reading != fresh)
  };
  content[fresh] = message
}

inline push(p_link)
{
  ticket = 0;
  do
  :: ticket < CAPACITY && link[p_link].held[ticket] -> ticket++
  :: else -> break
  od;
  if
  :: ticket < CAPACITY ->
     index = ring[p_link].tail;
     atomic { link[p_link].held[ticket] = true; link[p_link].owner[ticket] = index };
     STEP("push.ticket");
#if MUTANT == 2              /* shows the message before it is written */
     ring[p_link].tail = index + 1;
#endif
     ring[p_link].number[index % CAPACITY] = message;
     ring[p_link].ticket[index % CAPACITY] = ticket;
     ring[p_link].slot[index % CAPACITY] = fresh;
     STEP("push.entry");
     ring[p_link].tail = index + 1;
     STEP("push.tail");
     ring_bell = false;
     if
     :: ring[p_link].armed ->
        atomic { ring_bell = ring[p_link].armed; ring[p_link].armed = false };
        STEP("push.disarmed")
     :: else
     fi;
     link[p_link].buffer[ticket] = fresh;
     STEP("send.buffer");
     if
     :: ring_bell ->
        link[p_link].bell = true;
        STEP("send.bell")
     :: else
     fi
  :: else ->
     free(fresh)             /* full: this link does not get the message */
  fi
}

inline publish()
{
  for (to : 0 .. LINKS - 1) {
    if
    :: link[to].state == PROVED ->
#if MUTANT != 3              /* shares the message without a reference */
       references[fresh]++;
#endif
       STEP("share.reference");
       collect(to);
       do
       :: ring[to].tail - ring[to].head >= QUEUE -> drop_oldest(to)
       :: else -> break
       od;
       push(to)
    :: else
    fi
  };
  free(fresh)                /* that of the message itself */
}

#define OVER(i) (link[i].state != PROVED || ring[i].head == ring[i].tail)

active proctype Publisher()
{
  byte message = 1;
  byte slot, head, ticket, index, fresh, other, to;
  bool ring_bell;
  do
  :: message > MESSAGES -> break
  :: else ->
     reclaim();
     allocate();
     publish();
     message++
  od;
  /* Ends once nobody that lives has anything left to take or to give back: without a wake-up or a release that gets
     lost, this comes. */
  for (to : 0 .. LINKS - 1) {
    do
    :: link[to].state == PROVED && !link[to].subscriber_gone &&
       (ring[to].head != ring[to].tail || link[to].held[0] || link[to].held[1]) ->
       (WORK(to));
       serve(to);
       collect(to)
    :: else -> break
    od;
    serve(to)
  };
  for (slot : 0 .. SLOTS - 1) {
    fresh = 0;
    for (other : 0 .. LINKS - 1) {
      if
      :: link[other].subscriber_gone -> fresh = 1  /* died behind our back; its slots come with its close */
      :: else
      fi
    };
    assert(unused[slot] || fresh == 1)
  };
dead:
  atomic {
    for (other : 0 .. LINKS - 1) {
      link[other].publisher_gone = true
    }
  }
}

/* --------------------------------------------------------------------------------------------------- the subscribers */

inline peek()
{
  found = false;
  head = ring[me].head;
  do
  :: if
     :: head == ring[me].tail ->
        ring[me].armed = true;
        STEP("peek.armed");
#if MUTANT == 4              /* goes to sleep without another look */
        break
#else
        if
        :: head == ring[me].tail -> break
        :: else -> ring[me].armed = false
        fi
#endif
     :: else
     fi;
     number = ring[me].number[head % CAPACITY];
     ticket = ring[me].ticket[head % CAPACITY];
     slot = ring[me].slot[head % CAPACITY];
     STEP("peek.entry");
     now = ring[me].head;
     if
     :: now == head -> found = true; break
     :: else -> head = now
     fi
  od
}

inline take()
{
  taken = false;
  atomic {
    if
    :: ring[me].head == head ->
       ring[me].head = head + 1;
       link[me].settled++;
       link[me].reading = slot;
       taken = true
    :: else
    fi
  };
  if
  :: taken ->
     STEP("take.head")
  :: else
  fi
}

inline release()
{
#if MUTANT == 5              /* counts before it marks */
  ring[me].count++;
  STEP("release.count");
  ring[me].released[ticket] = true;
  STEP("release.mark")
#else
  ring[me].released[ticket] = true;
  STEP("release.mark");
  ring[me].count++;
  STEP("release.count")
#endif
}

/* Takes and releases until the ring is empty, which arms the doorbell. */
inline drain()
{
  do
  :: peek();
     if
     :: !found -> break
     :: else
     fi;
     take();
     if
     :: taken ->
        assert(number > last);
        last = number;
        assert(content[slot] == number);
        link[me].reading = NONE;  /* the last read comes before the release */
        release()
     :: else
     fi
  od
}

inline accept()
{
  STEP("accept.mapped");
  drain();                   /* arms the doorbell before the first message can be written */
  atomic {
    if
    :: link[me].state == OFFERED -> link[me].state = PROVED
    :: else
    fi
  };
  STEP("accept.proved")
}

proctype Subscriber(byte me)
{
  byte lives = LIVES;
  byte number, ticket, slot, head, now, last;
  bool found, taken;
born:
  last = 0;
  if
  :: link[me].state == ABSENT && !link[me].publisher_gone -> link[me].state = WANTED
  :: link[me].publisher_gone -> goto end
  fi;
  if
  :: link[me].state == OFFERED
  :: link[me].publisher_gone -> goto end
  fi;
  accept();
  do
  :: link[me].bell -> link[me].bell = false; drain()
  :: link[me].publisher_gone ->
     drain();                /* what was published arrives, however the publisher ended */
     assert(link[me].settled == ring[me].tail);
     goto end
  od;
dead:
  atomic {
    lives--;
    link[me].reading = NONE;
    link[me].subscriber_gone = true;
    found = false; taken = false; number = 0; ticket = 0; slot = 0; head = 0; now = 0
  };
  if
  :: lives > 0 ->
     if
     :: !link[me].subscriber_gone -> goto born  /* the publisher has closed the old link */
     :: link[me].publisher_gone
     fi
  :: else
  fi;
end:
  skip
}

init
{
  byte i;
  atomic {
    for (i : 0 .. LINKS - 1) {
      run Subscriber(i)
    }
  }
}

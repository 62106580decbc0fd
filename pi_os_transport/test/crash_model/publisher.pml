/* The publisher of link.pml. */

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

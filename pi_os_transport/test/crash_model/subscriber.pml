/* A subscriber of link.pml. */

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

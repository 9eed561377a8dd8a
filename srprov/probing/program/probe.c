/*
 * Ask from some network namespaces of this machine whether others are reached, and answer those who ask the same.
 *
 *   probe MAGIC MTU UNDERLAY_MTU QUIET_MS LIMIT_MS SELF... -- ENDPOINT...
 *
 *   ENDPOINT  a letter and an address: g a robot's own on the overlay, s a service's there, r a service's that every
 *             service is asked with, u a robot's on the underlay. All machines are given the same list.
 *   SELF      the index of an endpoint that is here, or INDEX:PATH with the network namespace where it is
 *
 * Small packets and those as large as the MTU are ICMP echo requests that must not be fragmented: the kernel at the
 * other end answers them. They carry who sent them to whom, so the other end knows what it heard, also where its
 * answers are lost; and the port where its TCP is heard, so no port has to be free. Between services there are also one
 * TCP connection, with a segment each way, and a UDP datagram to a multicast group. Loss and round trips are measured
 * between the robots' own addresses; elsewhere one packet that comes back is enough.
 *
 * A machine that heard all that it waits for tells the others so, once for all of its endpoints, and goes on answering
 * until all of them said the same.
 *
 * It ends when nobody wants anything any more, when it ran for QUIET_MS and learned nothing, or after LIMIT_MS; nothing that it
 * hears makes it stay longer. Then it writes a line of JSON for every SELF, as srprov/probing/answers.py reads it.
 */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define MOST_ENDPOINTS 1024
#define MOST_SELVES 128
#define MOST_CALLS 64   /* TCP connections that are being made */
#define MOST_SERVED 192 /* and those of others */
#define LARGEST 9216    /* bytes of a packet; a larger MTU is tried up to this */
#define SEGMENT 1000    /* bytes that TCP carries in each direction */
#define PINGS 5       /* between the robots' own addresses; to and from others one */
#define CALLS 4       /* tries of a TCP connection: the kernel itself sends a lost SYN again only after a second */
#define SPREAD_US 700 /* between the first packets to two peers, so that no queue on the way overflows */
#define HELLO_US 20000 /* after the first packet, then twice as long up to eight times */
#define GROUP "239.255.83.80"
#define GROUP_PORT 47583

enum { PING = 1, HELLO = 2, SIZE = 3, CAST = 4 };
enum { WANT = 1, WANT_CAST = 2, DONE = 4 };
enum { IDLE, CONNECTING, READING, WORKED, FAILED };

struct header { /* of every packet; numbers as the network has them */
    unsigned char magic[4];
    unsigned short from, to, port, size;
    unsigned char kind, flags, unused[2];
    unsigned int sent_high, sent_low;
};

union address {
    struct sockaddr any;
    struct sockaddr_in v4;
    struct sockaddr_in6 v6;
};

struct endpoint {
    char letter;
    union address address;
};

struct peer {
    long long pinged, next_ping, next_hello, hello_sent, next_size, cast_sent, called;
    unsigned long long rtt_sum;
    unsigned sent, got, rtt_min, rtt_max, hellos, sizes, fits, path_mtu;
    unsigned short port;
    unsigned char heard, cast, peer_done, told_done, cast_due, sized, call, tries;
    int error, unreachable, call_error;
    char other[INET6_ADDRSTRLEN];
};

struct self {
    int index, raw, cast_in, cast_out, listener, place, error;
    const char *path, *failed;
    unsigned short port;
    struct peer *peers;
};

struct call {
    struct self *me;
    int fd, peer;
    unsigned done;
};

static struct endpoint endpoints[MOST_ENDPOINTS];
static struct self selves[MOST_SELVES];
static struct call calls[MOST_CALLS];
static struct call served[MOST_SERVED];
static int endpoint_count, self_count, home_place;
static unsigned char magic[4];
static unsigned mtus[2];
static long long now, progress;
static int ready; /* nothing here waits for anything but for the others' being ready */
static const unsigned smaller[] = {8, 28, 50, 80, 130, 250, 500};

static long long clock_us(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (long long)t.tv_sec * 1000000 + t.tv_nsec / 1000;
}

/* ---- what is asked of whom ---- */

static int is_service(int i) { return endpoints[i].letter == 's' || endpoints[i].letter == 'r'; }

static int is_robot(int i) { return endpoints[i].letter == 'g'; }

static int is_underlay(int i) { return endpoints[i].letter == 'u'; }

static int asked(const struct self *me, int i) {
    if (i == me->index || is_underlay(i) != is_underlay(me->index)) return 0;
    return endpoints[i].letter != 's' || endpoints[me->index].letter != 's';
}

static int between_robots(const struct self *me, int i) { return is_robot(me->index) && is_robot(i); }

static unsigned pings(const struct self *me, int i) { return between_robots(me, i) ? PINGS : 1; }

static int with_streams(const struct self *me, int i) { return is_service(me->index) && is_service(i); }

static unsigned whole(const struct self *me) {
    unsigned mtu = mtus[is_underlay(me->index)];
    return mtu > LARGEST ? LARGEST : mtu;
}

static int pings_done(const struct self *me, int i) {
    const struct peer *p = &me->peers[i];
    return p->got && p->sent >= pings(me, i) && (p->got >= p->sent || now > p->pinged + 250000 + 2 * (long long)p->rtt_max);
}

static int complete(const struct self *me, int i) {
    const struct peer *p = &me->peers[i];
    if (!p->heard || !pings_done(me, i) || !p->sized) return 0;
    return !with_streams(me, i) || (p->cast && p->call >= WORKED);
}

/* ---- sending ---- */

static unsigned short checksum(const unsigned char *data, unsigned length) {
    unsigned long sum = 0;
    for (unsigned i = 0; i + 1 < length; i += 2) sum += (unsigned long)data[i] << 8 | data[i + 1];
    if (length & 1) sum += (unsigned long)data[length - 1] << 8;
    while (sum >> 16) sum = (sum & 0xffff) + (sum >> 16);
    return htons((unsigned short)~sum);
}

static void fill(struct header *h, const struct self *me, int to, int kind, unsigned flags, unsigned size) {
    unsigned long long stamp = (unsigned long long)clock_us();
    memset(h, 0, sizeof *h);
    memcpy(h->magic, magic, sizeof magic);
    h->from = htons((unsigned short)me->index);
    h->to = htons((unsigned short)to);
    h->port = htons(me->port);
    h->size = htons((unsigned short)size);
    h->kind = (unsigned char)kind;
    h->flags = (unsigned char)flags;
    h->sent_high = htonl((unsigned)(stamp >> 32));
    h->sent_low = htonl((unsigned)stamp);
}

/* size: bytes of the whole packet with its IP header; 0: as small as it can be */
static void echo(struct self *me, int i, int kind, unsigned flags, unsigned size) {
    static unsigned char packet[LARGEST];
    const union address *to = &endpoints[i].address;
    int v6 = to->any.sa_family == AF_INET6;
    unsigned least = (v6 ? 40 : 20) + 8 + sizeof(struct header);
    unsigned length;
    struct header h;
    if (me->raw < 0) return;
    if (size < least) size = least;
    if (size > LARGEST) size = LARGEST;
    length = size - (v6 ? 40 : 20);
    memset(packet, 0, length);
    packet[0] = v6 ? 128 : 8;
    packet[4] = magic[0];
    packet[5] = magic[1];
    packet[7] = (unsigned char)kind;
    fill(&h, me, i, kind, flags, size);
    memcpy(packet + 8, &h, sizeof h);
    if (!v6) {
        unsigned short sum = checksum(packet, length);
        memcpy(packet + 2, &sum, 2);
    }
    if (sendto(me->raw, packet, length, MSG_DONTWAIT, &to->any, v6 ? sizeof to->v6 : sizeof to->v4) < 0)
        if (errno != EAGAIN && errno != ENOBUFS && !(kind == SIZE && errno == EMSGSIZE)) me->peers[i].error = errno;
}

static void hello(struct self *me, int i) {
    struct peer *p = &me->peers[i];
    unsigned flags = 0;
    if (between_robots(me, i) && ready) flags |= DONE;
    if (!p->heard || (between_robots(me, i) && !p->peer_done)) flags |= WANT;
    if (with_streams(me, i) && !p->cast) flags |= WANT_CAST;
    if (flags & DONE) p->told_done = 1;
    p->hello_sent = now;
    echo(me, i, HELLO, flags, 0);
}

/* one datagram reaches everybody; `i` is who asked for it */
static void cast(struct self *me, int i) {
    struct sockaddr_in group = {.sin_family = AF_INET, .sin_port = htons(GROUP_PORT)};
    struct header h;
    for (int j = 0; j < endpoint_count; j++) me->peers[j].cast_due = 0;
    inet_pton(AF_INET, GROUP, &group.sin_addr);
    fill(&h, me, i, CAST, 0, 0);
    me->peers[me->index].cast_sent = now;
    if (me->cast_out >= 0) sendto(me->cast_out, &h, sizeof h, MSG_DONTWAIT, (struct sockaddr *)&group, sizeof group);
}

/* ---- TCP ---- */

static struct call *free_call(struct call *all, int most) {
    for (int i = 0; i < most; i++)
        if (all[i].fd < 0) return &all[i];
    return 0;
}

static void end_call(struct call *c, int state, int error) {
    struct peer *p = &c->me->peers[c->peer];
    struct linger hard = {1, 0}; /* leaves nothing waiting in the service's namespace */
    setsockopt(c->fd, SOL_SOCKET, SO_LINGER, &hard, sizeof hard);
    close(c->fd);
    c->fd = -1;
    p->call = (unsigned char)state;
    p->call_error = error;
    progress = now;
}

static int in_place(const struct self *me) { return me->place < 0 || !setns(me->place, CLONE_NEWNET); }

static void go_home(const struct self *me) {
    if (me->place >= 0 && setns(home_place, CLONE_NEWNET)) _exit(1);
}

static void begin_call(struct self *me, int i) {
    struct call *c = free_call(calls, MOST_CALLS);
    union address to = endpoints[i].address;
    union address from = endpoints[me->index].address;
    if (!c) return;
    if (!in_place(me)) return;
    c->fd = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    go_home(me);
    if (c->fd < 0) return;
    c->me = me;
    c->peer = i;
    c->done = 0;
    me->peers[i].call = CONNECTING;
    me->peers[i].called = now;
    me->peers[i].tries++;
    to.v4.sin_port = htons(me->peers[i].port);
    if (bind(c->fd, &from.any, sizeof from.v4) || (connect(c->fd, &to.any, sizeof to.v4) && errno != EINPROGRESS))
        end_call(c, FAILED, errno);
}

/* end one that hangs, so that it is begun again */
static void give_up_call(struct self *me, int i) {
    long long news = progress;
    for (int n = 0; n < MOST_CALLS; n++)
        if (calls[n].fd >= 0 && calls[n].me == me && calls[n].peer == i) end_call(&calls[n], IDLE, ETIMEDOUT);
    progress = news;
}

static unsigned char letter_at(unsigned i) { return (unsigned char)(i * 7 + 3); }

static void go_on(struct call *c) {
    struct peer *p = &c->me->peers[c->peer];
    unsigned char data[SEGMENT];
    ssize_t n;
    if (p->call == CONNECTING) {
        int error = 0;
        socklen_t length = sizeof error;
        getsockopt(c->fd, SOL_SOCKET, SO_ERROR, &error, &length);
        if (error) {
            end_call(c, FAILED, error);
            return;
        }
        for (unsigned i = 0; i < SEGMENT; i++) data[i] = letter_at(i);
        if (send(c->fd, data, SEGMENT, MSG_NOSIGNAL) != SEGMENT) {
            end_call(c, FAILED, errno);
            return;
        }
        p->call = READING;
        return;
    }
    n = recv(c->fd, data, SEGMENT - c->done, 0);
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (n <= 0) {
        end_call(c, FAILED, n ? errno : ECONNRESET);
        return;
    }
    for (ssize_t i = 0; i < n; i++)
        if (data[i] != letter_at(c->done + (unsigned)i)) {
            end_call(c, FAILED, EBADMSG);
            return;
        }
    c->done += (unsigned)n;
    if (c->done == SEGMENT) end_call(c, WORKED, 0);
}

static void take_call(struct self *me) {
    int fd = accept4(me->listener, 0, 0, SOCK_NONBLOCK | SOCK_CLOEXEC);
    struct call *c = free_call(served, MOST_SERVED);
    if (fd < 0) return;
    if (!c) {
        close(fd);
        return;
    }
    c->me = me;
    c->fd = fd;
    c->done = 0;
}

static void serve(struct call *c) {
    unsigned char data[SEGMENT];
    ssize_t n = recv(c->fd, data, SEGMENT - c->done, 0);
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (n > 0 && send(c->fd, data, (size_t)n, MSG_NOSIGNAL) == n && (c->done += (unsigned)n) < SEGMENT) return;
    if (n > 0 && c->done == SEGMENT) { /* the other end closes first; one byte more ends it too */
        c->done = SEGMENT - 1;
        return;
    }
    close(c->fd);
    c->fd = -1;
}

/* ---- hearing ---- */

static void note_source(struct peer *p, int i, const union address *source) {
    const union address *real = &endpoints[i].address;
    int same = source->any.sa_family == real->any.sa_family;
    if (same && source->any.sa_family == AF_INET) same = source->v4.sin_addr.s_addr == real->v4.sin_addr.s_addr;
    else if (same) same = !memcmp(&source->v6.sin6_addr, &real->v6.sin6_addr, 16);
    if (same) return;
    if (source->any.sa_family == AF_INET) inet_ntop(AF_INET, &source->v4.sin_addr, p->other, sizeof p->other);
    else inet_ntop(AF_INET6, &source->v6.sin6_addr, p->other, sizeof p->other);
}

static void on_request(struct self *me, const struct header *h, const union address *source) {
    int i = ntohs(h->from);
    struct peer *p;
    if (i >= endpoint_count || ntohs(h->to) != me->index || !asked(me, i)) return;
    p = &me->peers[i];
    note_source(p, i, source);
    if (!p->heard) progress = now;
    p->heard = 1;
    if (h->port) p->port = ntohs(h->port);
    if (h->kind != HELLO) return;
    if (h->flags & DONE && !p->peer_done) {
        p->peer_done = 1;
        progress = now;
    }
    if (h->flags & WANT_CAST) p->cast_due = 1;
    if (h->flags & WANT && now - p->hello_sent >= 10000) hello(me, i);
}

static void on_reply(struct self *me, const struct header *h, unsigned length) {
    int i = ntohs(h->to);
    long long sent = (long long)((unsigned long long)ntohl(h->sent_high) << 32 | ntohl(h->sent_low));
    struct peer *p;
    if (i >= endpoint_count || ntohs(h->from) != me->index || !asked(me, i)) return;
    p = &me->peers[i];
    if (h->kind == PING && p->got < p->sent && sent <= now && now - sent < 60000000) {
        unsigned rtt = (unsigned)(now - sent);
        if (!p->got || rtt < p->rtt_min) p->rtt_min = rtt;
        if (rtt > p->rtt_max) p->rtt_max = rtt;
        p->rtt_sum += rtt;
        p->got++;
        progress = now;
    }
    if (h->kind == SIZE && length >= ntohs(h->size) && ntohs(h->size) > p->fits) {
        p->fits = ntohs(h->size);
        if (p->fits >= whole(me)) p->sized = 1;
        progress = now;
    }
}

/* a machine on the way says why it did not pass a packet on; `inner` is that packet's ICMP */
static void on_error(struct self *me, int code, unsigned mtu, const unsigned char *inner, ssize_t length) {
    struct header h;
    int i;
    if (length < 8 + (ssize_t)sizeof h) return;
    memcpy(&h, inner + 8, sizeof h);
    i = ntohs(h.to);
    if (memcmp(h.magic, magic, sizeof magic) || ntohs(h.from) != me->index) return;
    if (i >= endpoint_count || !asked(me, i)) return;
    if (mtu) me->peers[i].path_mtu = mtu;
    else me->peers[i].unreachable = code + 1;
}

static void hear_v4(struct self *me, const unsigned char *data, ssize_t n, const union address *source) {
    ssize_t skip = n < 20 ? n : (data[0] & 15) * 4;
    const unsigned char *icmp = data + skip;
    struct header h;
    if (skip < 20 || n < skip + 8) return;
    if (icmp[0] == 3) {
        ssize_t left = n - skip - 8, inner = left < 20 ? left : (icmp[8] & 15) * 4;
        unsigned mtu = icmp[1] == 4 ? (unsigned)icmp[6] << 8 | icmp[7] : 0;
        if (inner >= 20 && left >= inner) on_error(me, icmp[1], mtu, icmp + 8 + inner, left - inner);
        return;
    }
    if (n < skip + 8 + (ssize_t)sizeof h) return;
    memcpy(&h, icmp + 8, sizeof h);
    if (memcmp(h.magic, magic, sizeof magic)) return;
    if (icmp[0] == 8) on_request(me, &h, source);
    if (icmp[0] == 0) on_reply(me, &h, (unsigned)n);
}

static void hear_v6(struct self *me, const unsigned char *icmp, ssize_t n, const union address *source) {
    struct header h;
    if (n < 8) return;
    if (icmp[0] == 1 || icmp[0] == 2) {
        unsigned mtu = icmp[0] == 2 ? (unsigned)icmp[6] << 8 | icmp[7] : 0;
        if (n > 48) on_error(me, icmp[1], mtu, icmp + 48, n - 48);
        return;
    }
    if (n < 8 + (ssize_t)sizeof h) return;
    memcpy(&h, icmp + 8, sizeof h);
    if (memcmp(h.magic, magic, sizeof magic)) return;
    if (icmp[0] == 128) on_request(me, &h, source);
    if (icmp[0] == 129) on_reply(me, &h, (unsigned)n + 40);
}

static void hear(struct self *me) {
    static unsigned char data[LARGEST + 128];
    for (int many = 0; many < 256; many++) {
        union address source;
        socklen_t length = sizeof source;
        ssize_t n;
        memset(&source, 0, sizeof source);
        n = recvfrom(me->raw, data, sizeof data, MSG_DONTWAIT, &source.any, &length);
        if (n < 0) return;
        now = clock_us();
        if (source.any.sa_family == AF_INET) hear_v4(me, data, n, &source);
        else if (source.any.sa_family == AF_INET6) hear_v6(me, data, n, &source);
    }
}

static void hear_cast(struct self *me) {
    for (int many = 0; many < 256; many++) {
        struct header h;
        ssize_t n = recv(me->cast_in, &h, sizeof h, MSG_DONTWAIT);
        int i;
        if (n < 0) return;
        i = ntohs(h.from);
        if (n != sizeof h || memcmp(h.magic, magic, sizeof magic) || h.kind != CAST) continue;
        if (i >= endpoint_count || !asked(me, i) || !with_streams(me, i)) continue;
        if (!me->peers[i].cast) progress = now;
        me->peers[i].cast = 1;
    }
}

/* ---- what is due ---- */

static void size_due(struct self *me, int i) {
    struct peer *p = &me->peers[i];
    long long pause = 2 * (long long)p->rtt_max;
    if (p->sizes < 3) echo(me, i, SIZE, 0, whole(me));
    else if (p->sizes < 5) {
        for (unsigned step = 0; step < sizeof smaller / sizeof *smaller; step++)
            if (whole(me) > smaller[step] + 100) echo(me, i, SIZE, 0, whole(me) - smaller[step]);
    } else p->sized = 1;
    p->sizes++;
    p->next_size = now + (pause < 80000 ? 80000 : pause > 500000 ? 500000 : pause);
}

/* bit 0: all is known of this pair; bit 1: and nothing more is to be told */
static int due(struct self *me, int i) {
    struct peer *p = &me->peers[i];
    unsigned wanted = pings(me, i);
    int is_complete = complete(me, i), over = is_complete;
    if (now >= p->next_ping && p->sent < 100 && !(p->got && p->sent >= wanted)) {
        p->sent++;
        p->pinged = now;
        p->next_ping = now + (p->sent < wanted ? 5000 : 100000);
        echo(me, i, PING, 0, 0);
    }
    if (p->got && !p->sized && now >= p->next_size) size_due(me, i);
    if (p->tries && p->tries < CALLS && p->call < WORKED && now - p->called > p->tries * 400000LL) give_up_call(me, i);
    if (with_streams(me, i) && p->heard && p->port && p->call == IDLE) begin_call(me, i);
    if (between_robots(me, i)) over = ready && p->peer_done;
    if ((between_robots(me, i) && ready && !p->told_done) || (!over && now >= p->next_hello)) {
        /* who begins late asks for what it has missed; who waits for it need not ask often */
        p->next_hello = now + (HELLO_US << (p->hellos < 3 ? p->hellos : 3));
        p->hellos++;
        hello(me, i);
    }
    return is_complete | over << 1;
}

static int all_due(void) {
    int known = 3;
    for (int s = 0; s < self_count; s++) {
        struct self *me = &selves[s];
        int wanted = 0;
        if (me->failed) continue;
        for (int i = 0; i < endpoint_count; i++) {
            if (!asked(me, i)) continue;
            known &= due(me, i);
            wanted |= me->peers[i].cast_due;
        }
        if (is_service(me->index) && wanted && now - me->peers[me->index].cast_sent >= 20000) cast(me, me->index);
    }
    ready = known & 1;
    return known == 3;
}

static void wait_and_hear(void) {
    static struct pollfd fds[3 * MOST_SELVES + MOST_CALLS + MOST_SERVED];
    static struct { char what; void *who; } whose[3 * MOST_SELVES + MOST_CALLS + MOST_SERVED];
    int count = 0;
#define ADD(number, letter, whom, direction)                                                                           \
    if ((number) >= 0) {                                                                                               \
        fds[count] = (struct pollfd){.fd = (number), .events = (direction)};                                           \
        whose[count].what = (letter);                                                                                  \
        whose[count++].who = (whom);                                                                                   \
    }
    for (int s = 0; s < self_count; s++) {
        ADD(selves[s].raw, 'r', &selves[s], POLLIN)
        ADD(selves[s].cast_in, 'm', &selves[s], POLLIN)
        ADD(selves[s].listener, 'l', &selves[s], POLLIN)
    }
    for (int i = 0; i < MOST_CALLS; i++) {
        int connecting = calls[i].fd >= 0 && calls[i].me->peers[calls[i].peer].call == CONNECTING;
        ADD(calls[i].fd, 'c', &calls[i], connecting ? POLLOUT : POLLIN)
    }
    for (int i = 0; i < MOST_SERVED; i++) ADD(served[i].fd, 's', &served[i], POLLIN)
#undef ADD
    if (poll(fds, (nfds_t)count, 2) < 0) return;
    now = clock_us();
    for (int i = 0; i < count; i++) {
        if (!fds[i].revents) continue;
        if (whose[i].what == 'r') hear(whose[i].who);
        else if (whose[i].what == 'm') hear_cast(whose[i].who);
        else if (whose[i].what == 'l') take_call(whose[i].who);
        else if (whose[i].what == 'c') go_on(whose[i].who);
        else serve(whose[i].who);
    }
}

/* ---- beginning ---- */

static int open_raw(const union address *mine) {
    int v6 = mine->any.sa_family == AF_INET6, probe = v6 ? IPV6_PMTUDISC_PROBE : IP_PMTUDISC_PROBE, large = 1 << 20;
    int fd = socket(mine->any.sa_family, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, v6 ? IPPROTO_ICMPV6 : IPPROTO_ICMP);
    if (fd < 0) return -1;
    setsockopt(fd, SOL_SOCKET, SO_RCVBUFFORCE, &large, sizeof large);
    setsockopt(fd, SOL_SOCKET, SO_SNDBUFFORCE, &large, sizeof large);
    if (v6) setsockopt(fd, IPPROTO_IPV6, IPV6_MTU_DISCOVER, &probe, sizeof probe);
    else setsockopt(fd, IPPROTO_IP, IP_MTU_DISCOVER, &probe, sizeof probe);
    if (bind(fd, &mine->any, v6 ? sizeof mine->v6 : sizeof mine->v4)) {
        int error = errno;
        close(fd);
        errno = error;
        return -1;
    }
    return fd;
}

static const char *open_streams(struct self *me) {
    union address mine = endpoints[me->index].address;
    struct sockaddr_in group = {.sin_family = AF_INET, .sin_port = htons(GROUP_PORT)};
    struct ip_mreq join = {.imr_interface = mine.v4.sin_addr};
    socklen_t length = sizeof mine;
    int on = 1;
    inet_pton(AF_INET, GROUP, &group.sin_addr);
    join.imr_multiaddr = group.sin_addr;
    me->listener = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (me->listener < 0 || bind(me->listener, &mine.any, sizeof mine.v4) || listen(me->listener, 128) ||
        getsockname(me->listener, &mine.any, &length))
        return "listen";
    me->port = ntohs(mine.v4.sin_port);
    mine.v4.sin_port = 0;
    me->cast_in = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (me->cast_in < 0 || setsockopt(me->cast_in, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) ||
        bind(me->cast_in, (struct sockaddr *)&group, sizeof group) ||
        setsockopt(me->cast_in, IPPROTO_IP, IP_ADD_MEMBERSHIP, &join, sizeof join))
        return "multicast";
    /* Linux sends multicast through the link that has the socket's own address; qemu-user knows no IP_MULTICAST_IF */
    me->cast_out = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (me->cast_out < 0 || bind(me->cast_out, &mine.any, sizeof mine.v4)) return "multicast";
    return 0;
}

static const char *open_self(struct self *me) {
    const char *failed = 0;
    int error;
    if (me->path && (me->place = open(me->path, O_RDONLY | O_CLOEXEC)) < 0) return "namespace";
    if (!in_place(me)) return "namespace";
    me->raw = open_raw(&endpoints[me->index].address);
    if (me->raw < 0) failed = "address";
    else if (is_service(me->index)) failed = open_streams(me);
    error = errno;
    go_home(me);
    errno = error;
    return failed;
}

static int parse_number(const char *text, long most, const char **end) {
    long value = 0;
    const char *at = text;
    while (*at >= '0' && *at <= '9' && value <= most) value = value * 10 + (*at++ - '0');
    if (at == text || value > most || (!end && *at)) return -1;
    if (end) *end = at;
    return (int)value;
}

static int parse_endpoint(const char *word) {
    struct endpoint *e = &endpoints[endpoint_count];
    e->letter = word[0];
    if (!word[0] || !strchr("gsru", word[0])) return 0;
    if (inet_pton(AF_INET, word + 1, &e->address.v4.sin_addr) == 1) e->address.any.sa_family = AF_INET;
    else if (word[0] == 'u' && inet_pton(AF_INET6, word + 1, &e->address.v6.sin6_addr) == 1)
        e->address.any.sa_family = AF_INET6;
    else return 0;
    endpoint_count++;
    return 1;
}

static int parse_magic(const char *word) {
    if (strlen(word) != 8) return 0;
    for (int i = 0; i < 8; i++) {
        const char *digits = "0123456789abcdef", *at = strchr(digits, word[i]);
        if (!at) return 0;
        magic[i / 2] = (unsigned char)(magic[i / 2] << 4 | (at - digits));
    }
    return 1;
}

static int parse(int count, char **words, int *quiet_ms, int *limit_ms) {
    int at = 6, first;
    if (count < 8 || !parse_magic(words[1])) return 0;
    mtus[0] = (unsigned)parse_number(words[2], 65535, 0);
    mtus[1] = (unsigned)parse_number(words[3], 65535, 0);
    *quiet_ms = parse_number(words[4], 60000, 0);
    *limit_ms = parse_number(words[5], 60000, 0);
    if ((int)mtus[0] < 0 || (int)mtus[1] < 0 || *quiet_ms < 0 || *limit_ms < 0) return 0;
    for (first = at; first < count && strcmp(words[first], "--"); first++) continue;
    for (int i = first + 1; i < count; i++)
        if (endpoint_count >= MOST_ENDPOINTS || !parse_endpoint(words[i])) return 0;
    for (; at < first; at++) {
        struct self *me = &selves[self_count];
        const char *end;
        if (self_count >= MOST_SELVES) return 0;
        me->index = parse_number(words[at], MOST_ENDPOINTS, &end);
        if (me->index < 0 || me->index >= endpoint_count || (*end && *end != ':')) return 0;
        me->path = *end ? end + 1 : 0;
        self_count++;
    }
    return self_count > 0;
}

/* ---- the result ---- */

static char out[16384];
static size_t out_length;

static void flush(void) {
    size_t done = 0;
    while (done < out_length) {
        ssize_t n = write(1, out + done, out_length - done);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) _exit(1);
        done += (size_t)n;
    }
    out_length = 0;
}

static void put(const char *text) {
    size_t length = strlen(text);
    if (out_length + length > sizeof out) flush();
    memcpy(out + out_length, text, length); /* every text is a constant of this file, a number or an address */
    out_length += length;
}

static void put_number(const char *before, long long value) {
    char digits[24], *at = digits + sizeof digits - 1;
    unsigned long long left = value < 0 ? 0 : (unsigned long long)value;
    *at = 0;
    do *--at = (char)('0' + left % 10);
    while (left /= 10);
    put(before);
    put(at);
}

static void put_peer(const struct self *me, int i) {
    const struct peer *p = &me->peers[i];
    put_number("[", i);
    put_number(",", p->sent);
    put_number(",", p->got);
    put_number(",", p->rtt_min);
    put_number(",", p->got ? (long long)(p->rtt_sum / p->got) : 0);
    put_number(",", p->rtt_max);
    put_number(",", p->heard);
    put_number(",", p->fits);
    put_number(",", p->path_mtu);
    put_number(",", p->cast);
    put_number(",", p->call == WORKED);
    put_number(",", p->call_error);
    put_number(",", p->error);
    put_number(",", p->unreachable);
    put(",\"");
    put(p->other);
    put("\"]");
}

static void put_self(const struct self *me, long long took) {
    int first = 1;
    put_number("{\"self\":", me->index);
    put_number(",\"ms\":", took / 1000);
    put(",\"failed\":\"");
    put(me->failed ? me->failed : "");
    put_number("\",\"error\":", me->error);
    put(",\"peers\":[");
    for (int i = 0; i < endpoint_count && !me->failed; i++) {
        if (!asked(me, i)) continue;
        if (!first) put(",");
        first = 0;
        put_peer(me, i);
    }
    put("]}\n");
}

int main(int count, char **words) {
    struct rlimit files = {1024, 1024};
    int quiet_ms, limit_ms;
    long long begun, waited = 0;
    if (!parse(count, words, &quiet_ms, &limit_ms)) {
        static const char usage[] = "probe: MAGIC MTU UNDERLAY_MTU QUIET_MS LIMIT_MS SELF... -- ENDPOINT...\n";
        return write(2, usage, sizeof usage - 1) < 0 ? 3 : 2;
    }
    alarm((unsigned)limit_ms / 1000 + 5); /* whatever happens, also while it writes */
    setrlimit(RLIMIT_NOFILE, &files);
    home_place = open("/proc/self/ns/net", O_RDONLY | O_CLOEXEC);
    for (int i = 0; i < MOST_CALLS; i++) calls[i].fd = -1;
    for (int i = 0; i < MOST_SERVED; i++) served[i].fd = -1;
    for (int s = 0; s < self_count; s++) {
        struct self *me = &selves[s];
        me->raw = me->cast_in = me->cast_out = me->listener = me->place = -1;
        me->peers = calloc((size_t)endpoint_count, sizeof *me->peers);
        if (!me->peers) return 1;
        errno = 0;
        me->failed = open_self(me);
        me->error = me->failed ? errno : 0;
    }
    now = begun = progress = clock_us();
    for (int s = 0; s < self_count; s++) {
        /* who comes after it in the list is asked first, so that not everybody asks the same one at once */
        for (int i = 0; i < endpoint_count && !selves[s].failed; i++) {
            int after = (i - selves[s].index + endpoint_count) % endpoint_count;
            selves[s].peers[i].next_ping = begun + after % 128 * SPREAD_US;
            selves[s].peers[i].next_hello = selves[s].peers[i].next_ping + HELLO_US;
        }
        if (is_service(selves[s].index) && !selves[s].failed) cast(&selves[s], selves[s].index);
    }
    while (!all_due() && waited < quiet_ms * 1000LL && now - begun < limit_ms * 1000LL) {
        long long before = now, news = progress;
        wait_and_hear();
        /* a busy machine may not let it run for a second: only time in which it could have heard something counts */
        waited = progress > news ? 0 : waited + (now - before < 10000 ? now - before : 10000);
    }
    for (int s = 0; s < self_count; s++) {
        struct self *me = &selves[s];
        for (int i = 0; i < endpoint_count && !me->failed; i++)
            if (ready && asked(me, i) && between_robots(me, i)) hello(me, i);
        put_self(me, now - begun);
    }
    flush();
    return 0;
}

/*
 * surefoot_game.h: lets a game in C or C++ run NPCs of Surefoot in its own physics, so that Surefoot proves graphs and measures
 * success there. One file, no dependencies: C99 or C++17, POSIX or Winsock (link ws2_32). The protocol:
 * docs/reference/game-protocol.md.
 *
 * In one source file:
 *
 *     #define SFG_IMPLEMENTATION
 *     #include "surefoot_game.h"
 *
 * Fill in an sfg_game and either block:
 *
 *     sfg_game game = { 0 };
 *     game.open = my_open;  game.close = my_close;  game.place = my_place;
 *     game.tick = my_tick;  game.state = my_state;  game.cast = my_cast;
 *     return sfg_serve("tcp://127.0.0.1:7701", &game) == 0 ? 0 : 1;
 *
 * or, in an engine with a main loop of its own, sfg_listen once and sfg_poll(server, 0) each frame: it carries out what has been asked,
 * calls back on this thread only, and never waits. Time belongs to the caller of decisions: between them nothing moves, and the ten ticks
 * of a decision are run at once, not at the speed of the clock.
 *
 *     surefoot graph export level.obj --world tcp://127.0.0.1:7701 --format json --out level.json
 *     surefoot eval --maps level.obj --world tcp://127.0.0.1:7701 --graph level.json
 *
 * Right-handed, y up; metres, seconds, radians. A client that connects can only steer characters, but there is no password: listen on
 * 127.0.0.1 or on a Unix socket. Lengths of what arrives are checked before anything is read into memory, and numbers must be finite.
 *
 * Errors: functions that return int return 0 or more, or -1; sfg_error(server) then says in one line what went wrong. A connection that
 * speaks nonsense is refused in a line and closed; others go on.
 */
#ifndef SUREFOOT_GAME_H
#define SUREFOOT_GAME_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SFG_VERSION 1
#define SFG_TICKS 10              /* ticks of a decision */
#define SFG_TICK_SECONDS (1.0f / 60.0f)
#define SFG_RAYS 64               /* rays of a character */
#define SFG_MAX_CHARACTERS 4096   /* characters of a world */
#define SFG_MAX_WORLDS 64         /* worlds at a time */
#define SFG_MAX_PLACES 1000
#define SFG_REFUSAL_BYTES 256

typedef struct sfg_vec3 { float x, y, z; } sfg_vec3;

/* The body that characters are to have. 1 or 0 where a float stands for a condition. */
typedef struct sfg_body {
    float height, radius;               /* m, from soles to crown */
    float forward_speed;                /* m/s */
    float side_speed_share;             /* top speed backwards and sideways, as a share of forward_speed */
    float turn_speed;                   /* rad/s */
    float jump_speed;                   /* m/s upwards */
    float gravity;                      /* m/s2 */
    float extra_jumps;                  /* jumps in the air before landing */
    float max_slope;                    /* steepest walkable slope, rad */
    float step_height;                  /* m, climbed without a jump */
    float ground_acceleration, air_acceleration; /* horizontal, m/s2 */
    float coyote_ticks;                 /* ticks after leaving the ground in which a jump still is one from the ground */
    float uses_zip_lines, zip_line_speed;
    float uses_jetpacks, jetpack_acceleration, jetpack_climb_speed;
} sfg_body;

/* Each -1 to 1: forward, strafe (positive to the right), turn (positive as yaw grows), jump (wanted above 0). */
typedef struct sfg_action { float forward, strafe, turn, jump; } sfg_action;

/* What a character does in a tick. In the first of the ten ticks of an action with jump above 0 one jump is wanted, as soon as it can be
 * made within the ten. */
typedef struct sfg_command { uint32_t character; sfg_action action; int is_first; } sfg_command;

enum {
    SFG_GROUNDED = 1u << 0,        /* stands on ground on which it can walk */
    SFG_CAN_JUMP = 1u << 1,        /* a jump wanted now would be made, from the ground or in the air */
    SFG_RIDES = 1u << 2,           /* rides a zip line */
    SFG_IN_WATER = 1u << 3,
    /* What it did in the last tick: */
    SFG_JUMPED = 1u << 8,
    SFG_DOUBLE_JUMPED = 1u << 9,
    SFG_PADDED = 1u << 10,
    SFG_ZIPPED = 1u << 11,
    SFG_TELEPORTED = 1u << 12,
    SFG_THRUST = 1u << 13,         /* a jetpack pushed it */
    /* How it came to harm, if it did; the library then ignores it until it places it again: */
    SFG_FELL = 1u << 16,
    SFG_BURNT = 2u << 16,
    SFG_DROWNED = 3u << 16,
    SFG_HARM = 3u << 16            /* the bits of harm */
};

/* feet: lowest point of the body, m; velocity: m/s; yaw: rad, at 0 the body faces +z, at pi/2 it faces +x; fuel: seconds of thrust left. */
typedef struct sfg_state { sfg_vec3 feet, velocity; float yaw, fuel; uint32_t flags; } sfg_state;

enum {
    SFG_GROUND = 0, SFG_WATER = 1, SFG_LAVA = 2, SFG_PAD = 3, SFG_ZIP_LINE = 4, SFG_TELEPORTER = 5, SFG_JETPACK = 6,
    SFG_NOTHING = 255
};

/* distance: m, 0 to the range of the rays; surface: SFG_NOTHING if nothing was hit. */
typedef struct sfg_hit { float distance; uint8_t surface; } sfg_hit;

/* What the game does. Characters of a world count from 0 and do not get in each other's way. */
typedef struct sfg_game {
    void *user;
    /* Makes a world of the level with `count` characters; NULL, and a line in `refusal`, if it cannot. */
    void *(*open)(void *user, const sfg_body *body, uint32_t count, char refusal[SFG_REFUSAL_BYTES]);
    /* Ends a world; NULL if there is nothing to do. */
    void (*close)(void *world);
    /* Puts a character there, at rest, unharmed and with nothing left of what it did. */
    void (*place)(void *world, uint32_t character, sfg_vec3 feet, float yaw);
    /* Advances the world by 1/60 s. The characters of `commands`, ascending, carry out their actions; all others may be ignored. */
    void (*tick)(void *world, const sfg_command *commands, uint32_t count);
    void (*state)(void *world, uint32_t character, sfg_state *state);
    /* Casts rays of at most `range` m in these unit directions. Characters are not in the way of rays. */
    void (*cast)(void *world, sfg_vec3 origin, const sfg_vec3 directions[SFG_RAYS], float range, sfg_hit hits[SFG_RAYS]);
    /* Writes up to `most` places to stand, drawn with `seed`, and returns how many; needed by training alone, may be NULL. */
    uint32_t (*places)(void *user, uint64_t seed, sfg_vec3 *places, uint32_t most);
} sfg_game;

typedef struct sfg_server sfg_server;

/* Listens at `address`, tcp://HOST:PORT (HOST is an IPv4 address, port 0 means a free one) or unix:PATH, where it replaces
 * a socket that lies there. NULL if it cannot, and a line in `error` if that is not NULL. `game` is copied. */
sfg_server *sfg_listen(const char *address, const sfg_game *game, char error[SFG_REFUSAL_BYTES]);
/* The port that is bound; 0 for a Unix socket. */
int sfg_port(const sfg_server *server);
/* Carries out what has been asked. Waits up to `timeout_ms` for something to do: 0 not at all, -1 as long as it takes. Returns the number
 * of messages that were carried out, or -1. */
int sfg_poll(sfg_server *server, int timeout_ms);
/* Number of worlds that are open. */
int sfg_worlds(const sfg_server *server);
/* What went wrong last, in a line; also why a connection was closed. "" if nothing did. */
const char *sfg_error(const sfg_server *server);
/* Ends all worlds and closes all connections. */
void sfg_free(sfg_server *server);
/* sfg_listen and sfg_poll without end; returns -1 after printing a line to stderr. */
int sfg_serve(const char *address, const sfg_game *game);

#ifdef __cplusplus
}
#endif
#endif

/* ------------------------------------------------------------------------------------------------------------------------------------ */
#if defined(SFG_IMPLEMENTATION) && !defined(SFG_IMPLEMENTED)
#define SFG_IMPLEMENTED

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <winsock2.h>
#include <ws2tcpip.h>
typedef SOCKET sfg_socket;
#define SFG_NO_SOCKET INVALID_SOCKET
#else
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>
typedef int sfg_socket;
#define SFG_NO_SOCKET (-1)
#endif

enum { SFG_REFUSED = 0, SFG_HELLO = 1, SFG_OPEN = 2, SFG_PLACES = 3, SFG_DECIDE = 4 };
enum { SFG_STATE_BYTES = 36, SFG_HITS_BYTES = 5 * SFG_RAYS, SFG_HELLO_BYTES = 24, SFG_OPEN_BYTES = 4 + 18 * 4 + 8 + SFG_RAYS * 12 };
enum { SFG_MOST_REQUEST = 8 + 8 + 2 * 20 * SFG_MAX_CHARACTERS };

/* A connection, which is one world. */
typedef struct sfg_peer {
    sfg_socket socket;
    void *world;
    uint32_t count;
    float eye, range;
    sfg_vec3 rays[SFG_RAYS];
    int said_hello, is_closing;
    unsigned char *in, *out;
    size_t in_used, in_size, out_used, out_sent, out_size;
} sfg_peer;

struct sfg_server {
    sfg_game game;
    sfg_socket socket;
    int port;
    char path[108];
    char error[SFG_REFUSAL_BYTES];
    sfg_peer *peers[SFG_MAX_WORLDS];
    int peer_count;
};

static void sfg_say(char *error, const char *text) {
    if (error) {
        snprintf(error, SFG_REFUSAL_BYTES, "%s", text);
    }
}

static void sfg_close_socket(sfg_socket socket) {
#ifdef _WIN32
    closesocket(socket);
#else
    close(socket);
#endif
}

static int sfg_would_block(void) {
#ifdef _WIN32
    return WSAGetLastError() == WSAEWOULDBLOCK;
#else
    return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
#endif
}

static int sfg_unblock(sfg_socket socket) {
#ifdef _WIN32
    u_long on = 1;
    return ioctlsocket(socket, FIONBIO, &on);
#else
    int flags = fcntl(socket, F_GETFL, 0);
    return flags < 0 ? -1 : fcntl(socket, F_SETFL, flags | O_NONBLOCK);
#endif
}

static uint32_t sfg_get(const unsigned char *at) {
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static void sfg_set(unsigned char *at, uint32_t value) {
    at[0] = (unsigned char)value;
    at[1] = (unsigned char)(value >> 8);
    at[2] = (unsigned char)(value >> 16);
    at[3] = (unsigned char)(value >> 24);
}

static float sfg_get_float(const unsigned char *at) {
    uint32_t bits = sfg_get(at);
    float value;
    memcpy(&value, &bits, 4);
    return value;
}

static void sfg_set_float(unsigned char *at, float value) {
    uint32_t bits;
    memcpy(&bits, &value, 4);
    sfg_set(at, bits);
}

static int sfg_is_finite(const unsigned char *at, size_t count) {
    size_t idx;
    for (idx = 0; idx < count; idx++) {
        if ((sfg_get(at + 4 * idx) & 0x7f800000u) == 0x7f800000u) {
            return 0;
        }
    }
    return 1;
}

/* Makes room for `bytes` more in the answer, and returns where they go; NULL without memory. */
static unsigned char *sfg_room(sfg_peer *peer, size_t bytes) {
    if (peer->out_used + bytes > peer->out_size) {
        size_t size = 2 * peer->out_size + bytes;
        unsigned char *out = (unsigned char *)realloc(peer->out, size);
        if (!out) {
            return NULL;
        }
        peer->out = out;
        peer->out_size = size;
    }
    peer->out_used += bytes;
    return peer->out + peer->out_used - bytes;
}

static unsigned char *sfg_answer(sfg_peer *peer, uint32_t kind, size_t bytes) {
    unsigned char *at = sfg_room(peer, 8 + bytes);
    if (!at) {
        return NULL;
    }
    sfg_set(at, kind);
    sfg_set(at + 4, (uint32_t)bytes);
    return at + 8;
}

/* Refuses in a line; the connection ends once that has been sent. Returns -1. */
static int sfg_refuse(sfg_server *server, sfg_peer *peer, const char *text) {
    unsigned char *at = sfg_answer(peer, SFG_REFUSED, strlen(text));
    if (at) {
        memcpy(at, text, strlen(text));
    }
    sfg_say(server->error, text);
    peer->is_closing = 1;
    return -1;
}

static int sfg_hello(sfg_server *server, sfg_peer *peer, const unsigned char *body) {
    static const uint32_t expected[6] = { 0x57474653u, SFG_VERSION, SFG_TICKS, 60, SFG_RAYS, SFG_STATE_BYTES };
    static const char *const names[6] = { "magic", "version", "ticks of a decision", "ticks of a second", "rays", "bytes of a state" };
    char text[SFG_REFUSAL_BYTES];
    unsigned char *at;
    int idx;
    for (idx = 0; idx < 6; idx++) {
        if (sfg_get(body + 4 * idx) != expected[idx]) {
            snprintf(text, sizeof text, "the hello says %u %s, expected %u", (unsigned)sfg_get(body + 4 * idx), names[idx],
                     (unsigned)expected[idx]);
            return sfg_refuse(server, peer, text);
        }
    }
    at = sfg_answer(peer, SFG_HELLO, SFG_HELLO_BYTES);
    if (!at) {
        return -1;
    }
    memcpy(at, body, SFG_HELLO_BYTES);
    peer->said_hello = 1;
    return 0;
}

static int sfg_open(sfg_server *server, sfg_peer *peer, const unsigned char *body) {
    char refusal[SFG_REFUSAL_BYTES] = "the game makes no world";
    sfg_body profile;
    float values[18];
    int idx;
    peer->count = sfg_get(body);
    if (peer->world) {
        return sfg_refuse(server, peer, "a connection has one world, which is open: connect again");
    }
    if (peer->count < 1 || peer->count > SFG_MAX_CHARACTERS) {
        return sfg_refuse(server, peer, "a world has 1 to 4096 characters");
    }
    if (!sfg_is_finite(body + 4, (SFG_OPEN_BYTES - 4) / 4)) {
        return sfg_refuse(server, peer, "the body or the rays have numbers that are not finite");
    }
    for (idx = 0; idx < 18; idx++) {
        values[idx] = sfg_get_float(body + 4 + 4 * idx);
    }
    memcpy(&profile, values, sizeof profile);
    peer->eye = sfg_get_float(body + 76);
    peer->range = sfg_get_float(body + 80);
    for (idx = 0; idx < SFG_RAYS; idx++) {
        peer->rays[idx].x = sfg_get_float(body + 84 + 12 * idx);
        peer->rays[idx].y = sfg_get_float(body + 88 + 12 * idx);
        peer->rays[idx].z = sfg_get_float(body + 92 + 12 * idx);
    }
    peer->world = server->game.open(server->game.user, &profile, peer->count, refusal);
    refusal[SFG_REFUSAL_BYTES - 1] = 0;
    if (!peer->world) {
        return sfg_refuse(server, peer, refusal[0] ? refusal : "the game makes no world");
    }
    return sfg_answer(peer, SFG_OPEN, 0) ? 0 : -1;
}

static int sfg_places(sfg_server *server, sfg_peer *peer, const unsigned char *body) {
    uint64_t seed = (uint64_t)sfg_get(body) | (uint64_t)sfg_get(body + 4) << 32;
    uint32_t most = sfg_get(body + 8), found = 0, idx;
    sfg_vec3 *places;
    unsigned char *at;
    if (!server->game.places) {
        return sfg_refuse(server, peer, "it knows no places for goals at random: give goals");
    }
    most = most < SFG_MAX_PLACES ? most : SFG_MAX_PLACES;
    places = (sfg_vec3 *)calloc(SFG_MAX_PLACES, sizeof *places);
    if (!places) {
        return -1;
    }
    found = server->game.places(server->game.user, seed, places, most);
    found = found < most ? found : most;
    at = sfg_answer(peer, SFG_PLACES, 12 * (size_t)found);
    for (idx = 0; at && idx < found; idx++, at += 12) {
        sfg_set_float(at, places[idx].x);
        sfg_set_float(at + 4, places[idx].y);
        sfg_set_float(at + 8, places[idx].z);
    }
    free(places);
    return at ? 0 : -1;
}

static void sfg_write_state(unsigned char *at, const sfg_state *state) {
    sfg_set_float(at, state->feet.x);
    sfg_set_float(at + 4, state->feet.y);
    sfg_set_float(at + 8, state->feet.z);
    sfg_set_float(at + 12, state->velocity.x);
    sfg_set_float(at + 16, state->velocity.y);
    sfg_set_float(at + 20, state->velocity.z);
    sfg_set_float(at + 24, state->yaw);
    sfg_set_float(at + 28, state->fuel);
    sfg_set(at + 32, state->flags);
}

/* Casts the rays of a character and writes what they hit. */
static void sfg_look(const sfg_server *server, const sfg_peer *peer, const sfg_state *state, unsigned char *at) {
    sfg_vec3 origin = state->feet, directions[SFG_RAYS];
    sfg_hit hits[SFG_RAYS];
    float sin_yaw = sinf(state->yaw), cos_yaw = cosf(state->yaw);
    int ray;
    origin.y += peer->eye;
    for (ray = 0; ray < SFG_RAYS; ray++) {
        /* x of a ray is to the right of the body, z ahead of it. */
        sfg_vec3 it = peer->rays[ray];
        directions[ray].x = sin_yaw * it.z - cos_yaw * it.x;
        directions[ray].y = it.y;
        directions[ray].z = cos_yaw * it.z + sin_yaw * it.x;
        hits[ray].distance = 0.0f;
        hits[ray].surface = SFG_NOTHING;
    }
    server->game.cast(peer->world, origin, (const sfg_vec3 *)directions, peer->range, hits);
    for (ray = 0; ray < SFG_RAYS; ray++) {
        sfg_set_float(at + 4 * ray, hits[ray].surface == SFG_NOTHING ? 0.0f : hits[ray].distance);
        at[4 * SFG_RAYS + ray] = hits[ray].surface;
    }
}

/* Whether `count` entries of 20 bytes name characters of the world, ascending, with finite numbers. */
static int sfg_are_sound(const sfg_peer *peer, const unsigned char *at, uint32_t count) {
    uint32_t idx;
    for (idx = 0; idx < count; idx++, at += 20) {
        if (sfg_get(at) >= peer->count || (idx > 0 && sfg_get(at) <= sfg_get(at - 20)) || !sfg_is_finite(at + 4, 4)) {
            return 0;
        }
    }
    return 1;
}

static int sfg_decide(sfg_server *server, sfg_peer *peer, const unsigned char *body, size_t bytes) {
    const sfg_game *game = &server->game;
    uint32_t acting = sfg_get(body), placing = sfg_get(body + 4), idx, tick, moving;
    const size_t per_action = SFG_TICKS * SFG_STATE_BYTES + SFG_HITS_BYTES, per_place = SFG_STATE_BYTES + SFG_HITS_BYTES;
    const unsigned char *actions = body + 8, *places;
    unsigned char *at;
    sfg_command *commands;
    sfg_state *states;
    if (!peer->world) {
        return sfg_refuse(server, peer, "there is no world: open one first");
    }
    if (acting > peer->count || placing > peer->count || bytes != 8 + 20 * ((size_t)acting + placing)) {
        return sfg_refuse(server, peer, "the length of a decision does not agree with its counts");
    }
    places = actions + 20 * (size_t)acting;
    if (!sfg_are_sound(peer, actions, acting) || !sfg_are_sound(peer, places, placing)) {
        return sfg_refuse(server, peer, "a decision names characters that do not exist or do not ascend, or has numbers that are not finite");
    }
    at = sfg_answer(peer, SFG_DECIDE, acting * per_action + placing * per_place);
    commands = (sfg_command *)calloc(acting + 1, sizeof *commands);
    states = (sfg_state *)calloc(acting + 1, sizeof *states);
    if (!at || !commands || !states) {
        free(commands);
        free(states);
        return -1;
    }
    for (idx = 0; idx < acting; idx++) {
        game->state(peer->world, sfg_get(actions + 20 * idx), &states[idx]);
    }
    for (tick = 0; acting > 0 && tick < SFG_TICKS; tick++) {
        moving = 0;
        for (idx = 0; idx < acting; idx++) {
            const unsigned char *action = actions + 20 * idx;
            sfg_command *command = &commands[moving];
            if (states[idx].flags & SFG_HARM) {
                continue;
            }
            command->character = sfg_get(action);
            command->action.forward = sfg_get_float(action + 4);
            command->action.strafe = sfg_get_float(action + 8);
            command->action.turn = sfg_get_float(action + 12);
            command->action.jump = sfg_get_float(action + 16);
            command->is_first = tick == 0;
            moving++;
        }
        game->tick(peer->world, commands, moving);
        for (idx = 0; idx < acting; idx++) {
            if (!(states[idx].flags & SFG_HARM)) {
                game->state(peer->world, sfg_get(actions + 20 * idx), &states[idx]);
            }
            sfg_write_state(at + idx * per_action + tick * SFG_STATE_BYTES, &states[idx]);
        }
    }
    for (idx = 0; idx < acting; idx++) {
        sfg_look(server, peer, &states[idx], at + idx * per_action + SFG_TICKS * SFG_STATE_BYTES);
    }
    at += acting * per_action;
    for (idx = 0; idx < placing; idx++) {
        const unsigned char *place = places + 20 * idx;
        sfg_vec3 feet;
        feet.x = sfg_get_float(place + 4);
        feet.y = sfg_get_float(place + 8);
        feet.z = sfg_get_float(place + 12);
        game->place(peer->world, sfg_get(place), feet, sfg_get_float(place + 16));
    }
    for (idx = 0; idx < placing; idx++, at += per_place) {
        sfg_state state;
        memset(&state, 0, sizeof state);
        game->state(peer->world, sfg_get(places + 20 * idx), &state);
        sfg_write_state(at, &state);
        sfg_look(server, peer, &state, at + SFG_STATE_BYTES);
    }
    free(commands);
    free(states);
    return 0;
}

/* Carries out the first message if it is complete: 1, 0 if it is not, -1 if the connection must end. */
static int sfg_message(sfg_server *server, sfg_peer *peer) {
    uint32_t kind, bytes;
    int failed;
    if (peer->in_used < 8) {
        return 0;
    }
    kind = sfg_get(peer->in);
    bytes = sfg_get(peer->in + 4);
    if (!peer->said_hello && (kind != SFG_HELLO || bytes != SFG_HELLO_BYTES)) {
        return sfg_refuse(server, peer, "the first message is no hello of the batch protocol");
    }
    if (kind < SFG_HELLO || kind > SFG_DECIDE) {
        return sfg_refuse(server, peer, "a message is of an unknown kind");
    }
    if ((kind == SFG_HELLO && bytes != SFG_HELLO_BYTES) || (kind == SFG_OPEN && bytes != SFG_OPEN_BYTES) ||
        (kind == SFG_PLACES && bytes != 12) || (kind == SFG_DECIDE && bytes < 8) || bytes > SFG_MOST_REQUEST - 8) {
        return sfg_refuse(server, peer, "a message has a length that its kind cannot have");
    }
    if (peer->in_used < 8 + (size_t)bytes) {
        if (peer->in_size < 8 + (size_t)bytes) {
            unsigned char *in = (unsigned char *)realloc(peer->in, 8 + (size_t)bytes);
            if (!in) {
                return -1;
            }
            peer->in = in;
            peer->in_size = 8 + (size_t)bytes;
        }
        return 0;
    }
    failed = kind == SFG_HELLO    ? sfg_hello(server, peer, peer->in + 8)
             : kind == SFG_OPEN   ? sfg_open(server, peer, peer->in + 8)
             : kind == SFG_PLACES ? sfg_places(server, peer, peer->in + 8)
                                  : sfg_decide(server, peer, peer->in + 8, bytes);
    peer->in_used -= 8 + (size_t)bytes;
    memmove(peer->in, peer->in + 8 + bytes, peer->in_used);
    return failed ? -1 : 1;
}

/* Sends what is left of the answer: 0, or -1 if the connection is lost. */
static int sfg_send(sfg_peer *peer) {
    while (peer->out_sent < peer->out_used) {
#ifdef MSG_NOSIGNAL
        const int flags = MSG_NOSIGNAL;
#else
        const int flags = 0;
#endif
        long sent = (long)send(peer->socket, (const char *)peer->out + peer->out_sent, (unsigned)(peer->out_used - peer->out_sent), flags);
        if (sent < 0) {
            return sfg_would_block() ? 0 : -1;
        }
        peer->out_sent += (size_t)sent;
    }
    peer->out_used = peer->out_sent = 0;
    return 0;
}

/* Serves a connection as far as that goes without waiting: how many messages, or -1 if it is over. */
static int sfg_attend(sfg_server *server, sfg_peer *peer) {
    int count = 0;
    for (;;) {
        long received;
        int done;
        if (sfg_send(peer) < 0 || (peer->is_closing && peer->out_used == 0)) {
            return -1;
        }
        /* Nothing more is read until the answer is gone. */
        if (peer->out_used > 0) {
            return count;
        }
        done = sfg_message(server, peer);
        if (done < 0 && !peer->is_closing) {
            sfg_say(server->error, "there is no memory for a message");
            return -1;
        }
        if (done != 0) {
            count += done > 0;
            continue;
        }
        /* Others have their turn; what has arrived wakes the next poll. */
        if (count >= 8) {
            return count;
        }
        received = (long)recv(peer->socket, (char *)peer->in + peer->in_used, (unsigned)(peer->in_size - peer->in_used), 0);
        if (received == 0) {
            return -1;
        }
        if (received < 0) {
            return sfg_would_block() ? count : -1;
        }
        peer->in_used += (size_t)received;
    }
}

static void sfg_drop(sfg_server *server, int idx) {
    sfg_peer *peer = server->peers[idx];
    if (peer->world && server->game.close) {
        server->game.close(peer->world);
    }
    sfg_close_socket(peer->socket);
    free(peer->in);
    free(peer->out);
    free(peer);
    server->peers[idx] = server->peers[--server->peer_count];
}

static void sfg_accept(sfg_server *server) {
    /* When the limit is reached, a new client waits until a place is free. */
    while (server->peer_count < SFG_MAX_WORLDS) {
        sfg_peer *peer;
        int on = 1;
        sfg_socket socket = accept(server->socket, NULL, NULL);
        if (socket == SFG_NO_SOCKET) {
            return;
        }
        peer = (sfg_peer *)calloc(1, sizeof *peer);
        if (peer) {
            peer->in_size = 4096;
            peer->in = (unsigned char *)malloc(peer->in_size);
        }
        if (!peer || !peer->in || sfg_unblock(socket) != 0) {
            sfg_say(server->error, "a connection was closed: there is no memory for it");
            if (peer) {
                free(peer->in);
            }
            free(peer);
            sfg_close_socket(socket);
            continue;
        }
        if (server->port) {
            setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, (const char *)&on, sizeof on);
        }
        peer->socket = socket;
        server->peers[server->peer_count++] = peer;
    }
}

/* Waits until a socket has something to do. */
static int sfg_wait(sfg_server *server, int timeout_ms) {
#ifdef _WIN32
    WSAPOLLFD fds[SFG_MAX_WORLDS + 1];
#else
    struct pollfd fds[SFG_MAX_WORLDS + 1];
#endif
    int idx;
    memset(fds, 0, sizeof fds);
    fds[0].fd = server->socket;
    fds[0].events = server->peer_count < SFG_MAX_WORLDS ? POLLIN : 0;
    for (idx = 0; idx < server->peer_count; idx++) {
        fds[idx + 1].fd = server->peers[idx]->socket;
        fds[idx + 1].events = server->peers[idx]->out_used > 0 ? POLLOUT : POLLIN;
    }
#ifdef _WIN32
    return WSAPoll(fds, (ULONG)server->peer_count + 1, timeout_ms) < 0 ? -1 : 0;
#else
    return poll(fds, (nfds_t)server->peer_count + 1, timeout_ms) < 0 && errno != EINTR ? -1 : 0;
#endif
}

int sfg_poll(sfg_server *server, int timeout_ms) {
    int idx, count = 0;
    if (sfg_wait(server, timeout_ms) < 0) {
        sfg_say(server->error, "cannot wait for the sockets");
        return -1;
    }
    sfg_accept(server);
    for (idx = server->peer_count - 1; idx >= 0; idx--) {
        int done = sfg_attend(server, server->peers[idx]);
        if (done < 0) {
            sfg_drop(server, idx);
        } else {
            count += done;
        }
    }
    return count;
}

static sfg_socket sfg_bind_tcp(const char *host, int *port, char *error) {
    char name[64];
    const char *colon = strrchr(host, ':');
    struct sockaddr_in at;
    socklen_t bytes = sizeof at;
    int on = 1;
    sfg_socket socket_;
    memset(&at, 0, sizeof at);
    at.sin_family = AF_INET;
    if (!colon || (size_t)(colon - host) >= sizeof name) {
        sfg_say(error, "the address must be tcp://HOST:PORT or unix:PATH");
        return SFG_NO_SOCKET;
    }
    memcpy(name, host, (size_t)(colon - host));
    name[colon - host] = 0;
    *port = atoi(colon + 1);
    at.sin_port = htons((uint16_t)*port);
    if (*port < 0 || *port > 65535 || inet_pton(AF_INET, strcmp(name, "localhost") == 0 ? "127.0.0.1" : name, &at.sin_addr) != 1) {
        sfg_say(error, "the address must have an IPv4 address and a port from 0 to 65535");
        return SFG_NO_SOCKET;
    }
    socket_ = socket(AF_INET, SOCK_STREAM, 0);
    if (socket_ == SFG_NO_SOCKET) {
        sfg_say(error, "there is no socket");
        return SFG_NO_SOCKET;
    }
#ifndef _WIN32
    setsockopt(socket_, SOL_SOCKET, SO_REUSEADDR, (const char *)&on, sizeof on);
#else
    (void)on;
#endif
    if (bind(socket_, (const struct sockaddr *)&at, sizeof at) != 0 || getsockname(socket_, (struct sockaddr *)&at, &bytes) != 0) {
        sfg_say(error, "the port is taken, or not permitted");
        sfg_close_socket(socket_);
        return SFG_NO_SOCKET;
    }
    *port = ntohs(at.sin_port);
    return socket_;
}

static sfg_socket sfg_bind_unix(const char *path, char *error) {
#ifdef _WIN32
    (void)path;
    sfg_say(error, "there are no Unix sockets here: use tcp://HOST:PORT");
    return SFG_NO_SOCKET;
#else
    struct sockaddr_un at;
    struct stat found;
    int socket_;
    memset(&at, 0, sizeof at);
    at.sun_family = AF_UNIX;
    if (strlen(path) >= sizeof at.sun_path || !path[0]) {
        sfg_say(error, "the path of the Unix socket is empty or too long");
        return SFG_NO_SOCKET;
    }
    memcpy(at.sun_path, path, strlen(path) + 1);
    socket_ = socket(AF_UNIX, SOCK_STREAM, 0);
    /* S_ISSOCK, which strict C99 does not declare. */
    if (stat(path, &found) == 0 && (found.st_mode & 0170000) == 0140000) {
        unlink(path);
    }
    if (socket_ < 0 || bind(socket_, (const struct sockaddr *)&at, sizeof at) != 0) {
        sfg_say(error, "the path of the Unix socket is not permitted");
        if (socket_ >= 0) {
            close(socket_);
        }
        return SFG_NO_SOCKET;
    }
    return socket_;
#endif
}

sfg_server *sfg_listen(const char *address, const sfg_game *game, char error[SFG_REFUSAL_BYTES]) {
    sfg_server *server;
#ifdef _WIN32
    WSADATA data;
    if (WSAStartup(MAKEWORD(2, 2), &data) != 0) {
        sfg_say(error, "Winsock does not start");
        return NULL;
    }
#endif
    if (!game->open || !game->place || !game->tick || !game->state || !game->cast) {
        sfg_say(error, "open, place, tick, state and cast must be given");
        return NULL;
    }
    server = (sfg_server *)calloc(1, sizeof *server);
    if (!server) {
        sfg_say(error, "there is no memory");
        return NULL;
    }
    server->game = *game;
    server->socket = SFG_NO_SOCKET;
    if (strncmp(address, "tcp://", 6) == 0) {
        server->socket = sfg_bind_tcp(address + 6, &server->port, error);
    } else if (strncmp(address, "unix:", 5) == 0) {
        server->socket = sfg_bind_unix(address + 5, error);
        snprintf(server->path, sizeof server->path, "%s", address + 5);
    } else {
        sfg_say(error, "the address must be tcp://HOST:PORT or unix:PATH");
    }
    if (server->socket == SFG_NO_SOCKET || listen(server->socket, SFG_MAX_WORLDS) != 0 || sfg_unblock(server->socket) != 0) {
        if (server->socket != SFG_NO_SOCKET) {
            sfg_say(error, "cannot listen there");
            sfg_close_socket(server->socket);
        }
        free(server);
        return NULL;
    }
    return server;
}

int sfg_port(const sfg_server *server) { return server->port; }

int sfg_worlds(const sfg_server *server) {
    int idx, count = 0;
    for (idx = 0; idx < server->peer_count; idx++) {
        count += server->peers[idx]->world != NULL;
    }
    return count;
}

const char *sfg_error(const sfg_server *server) { return server->error; }

void sfg_free(sfg_server *server) {
    if (!server) {
        return;
    }
    while (server->peer_count > 0) {
        sfg_drop(server, 0);
    }
    sfg_close_socket(server->socket);
#ifndef _WIN32
    if (server->path[0]) {
        unlink(server->path);
    }
#endif
    free(server);
}

int sfg_serve(const char *address, const sfg_game *game) {
    char error[SFG_REFUSAL_BYTES] = "";
    sfg_server *server = sfg_listen(address, game, error);
    while (server && sfg_poll(server, -1) >= 0) {
    }
    fprintf(stderr, "cannot serve %s: %s\n", address, server ? sfg_error(server) : error);
    sfg_free(server);
    return -1;
}

#endif

/*
 * The smallest game: characters that stay where they are and see nothing. Measures what lies between (embed/game/examples/speed.rs), and is a
 * place to start from.
 *
 *     cc -O2 -I embed/game/c embed/game/c/examples/still.c -o still -lm
 *     ./still tcp://127.0.0.1:7701
 */
#define SFG_IMPLEMENTATION
#include "surefoot_game.h"

static void *open_world(void *user, const sfg_body *body, uint32_t count, char refusal[SFG_REFUSAL_BYTES]) {
    (void)user;
    (void)body;
    (void)refusal;
    return calloc(count, sizeof(sfg_state));
}

static void place(void *world, uint32_t character, sfg_vec3 feet, float yaw) {
    sfg_state *it = (sfg_state *)world + character;
    memset(it, 0, sizeof *it);
    it->feet = feet;
    it->yaw = yaw;
    it->flags = SFG_GROUNDED | SFG_CAN_JUMP;
}

static void tick(void *world, const sfg_command *commands, uint32_t count) {
    (void)world;
    (void)commands;
    (void)count;
}

static void state(void *world, uint32_t character, sfg_state *state) { *state = ((const sfg_state *)world)[character]; }

/* All rays hit nothing unless something is written. */
static void cast(void *world, sfg_vec3 origin, const sfg_vec3 directions[SFG_RAYS], float range, sfg_hit hits[SFG_RAYS]) {
    (void)world;
    (void)origin;
    (void)directions;
    (void)range;
    (void)hits;
}

int main(int argc, char **argv) {
    sfg_game game;
    memset(&game, 0, sizeof game);
    game.open = open_world;
    game.close = free;
    game.place = place;
    game.tick = tick;
    game.state = state;
    game.cast = cast;
    return sfg_serve(argc > 1 ? argv[1] : "tcp://127.0.0.1:7701", &game) == 0 ? 0 : 1;
}

/*
 * A game of boxes: a level of upright boxes, and characters that walk, jump and fall on them, over surefoot_game.h.
 *
 *     cc -O2 -I embed/game/c embed/game/c/examples/boxes.c -o boxes -lm
 *     ./boxes embed/game/examples/boxes.obj tcp://127.0.0.1:7701 2 1 2
 *     surefoot eval --maps embed/game/examples/boxes.obj --world tcp://127.0.0.1:7701
 *
 * The three numbers say where the origin of the level lies on Surefoot's map, as `surefoot map import` prints it: places that arrive are
 * in the map's coordinates. Each object of the .obj file is one box. Characters are upright boxes, as wide as their bodies.
 */
#define SFG_IMPLEMENTATION
#include "surefoot_game.h"

#define MOST_BOXES 1024
#define MAX_FALL_SPEED 45.0f
#define TOUCH 0.001f /* m */

typedef struct box { float low[3], high[3]; } box;

typedef struct boxes {
    box boxes[MOST_BOXES];
    int count;
    float low; /* below that a body has fallen out of the level */
} boxes;

typedef struct character {
    sfg_state state;
    int air_jumps_left, ticks_in_air, wants_jump;
} character;

typedef struct world {
    const boxes *level;
    sfg_body body;
    uint32_t count;
    character *characters;
} world;

/* Reads an .obj file, and moves it by `origin`. */
static int load(boxes *level, const char *path, const float origin[3]) {
    FILE *file = fopen(path, "r");
    char line[256];
    int axis;
    if (!file) {
        return -1;
    }
    level->count = 0;
    level->low = 1.0e9f;
    while (fgets(line, sizeof line, file)) {
        float at[3];
        if (line[0] == 'o' && level->count < MOST_BOXES) {
            box *begun = &level->boxes[level->count++];
            for (axis = 0; axis < 3; axis++) {
                begun->low[axis] = 1.0e9f;
                begun->high[axis] = -1.0e9f;
            }
        } else if (level->count > 0 && sscanf(line, "v %f %f %f", &at[0], &at[1], &at[2]) == 3) {
            box *it = &level->boxes[level->count - 1];
            for (axis = 0; axis < 3; axis++) {
                at[axis] += origin[axis];
                it->low[axis] = at[axis] < it->low[axis] ? at[axis] : it->low[axis];
                it->high[axis] = at[axis] > it->high[axis] ? at[axis] : it->high[axis];
            }
            level->low = at[1] - 1.0f < level->low ? at[1] - 1.0f : level->low;
        }
    }
    fclose(file);
    return level->count > 0 ? 0 : -1;
}

static void *open_world(void *user, const sfg_body *body, uint32_t count, char refusal[SFG_REFUSAL_BYTES]) {
    world *it = (world *)calloc(1, sizeof *it);
    character *characters = (character *)calloc(count, sizeof *characters);
    if (!it || !characters) {
        snprintf(refusal, SFG_REFUSAL_BYTES, "there is no memory for %u characters", (unsigned)count);
        free(it);
        free(characters);
        return NULL;
    }
    it->level = (const boxes *)user;
    it->body = *body;
    it->count = count;
    it->characters = characters;
    return it;
}

static void close_world(void *world_) {
    world *it = (world *)world_;
    free(it->characters);
    free(it);
}

static void place(void *world_, uint32_t idx, sfg_vec3 feet, float yaw) {
    character *it = &((world *)world_)->characters[idx];
    memset(it, 0, sizeof *it);
    it->state.feet = feet;
    it->state.yaw = yaw;
    it->ticks_in_air = 255;
}

/* The first box that a body whose feet are there reaches into; NULL if none. */
static const box *hit(const world *in, const float feet[3]) {
    const float radius = in->body.radius, height = in->body.height;
    int idx;
    for (idx = 0; idx < in->level->count; idx++) {
        const box *it = &in->level->boxes[idx];
        if (feet[0] + radius > it->low[0] + TOUCH && feet[0] - radius < it->high[0] - TOUCH && feet[2] + radius > it->low[2] + TOUCH &&
            feet[2] - radius < it->high[2] - TOUCH && feet[1] + height > it->low[1] + TOUCH && feet[1] < it->high[1] - TOUCH) {
            return it;
        }
    }
    return NULL;
}

/* Turns the body, and changes its velocity as the action wants and gravity does. */
static void steer(const sfg_body *body, character *it, const sfg_action *action) {
    sfg_state *state = &it->state;
    float sin_yaw, cos_yaw, forward, right, x, z, length, limit;
    state->yaw += action->turn * body->turn_speed * SFG_TICK_SECONDS;
    sin_yaw = sinf(state->yaw);
    cos_yaw = cosf(state->yaw);
    forward = action->forward < -body->side_speed_share ? -body->side_speed_share : action->forward;
    right = action->strafe * body->side_speed_share;
    x = sin_yaw * forward - cos_yaw * right;
    z = cos_yaw * forward + sin_yaw * right;
    length = sqrtf(x * x + z * z);
    length = length > 1.0f ? length : 1.0f;
    x = x / length * body->forward_speed - state->velocity.x;
    z = z / length * body->forward_speed - state->velocity.z;
    length = sqrtf(x * x + z * z);
    limit = (state->flags & SFG_GROUNDED ? body->ground_acceleration : body->air_acceleration) * SFG_TICK_SECONDS;
    limit = length > limit ? limit / length : 1.0f;
    state->velocity.x += x * limit;
    state->velocity.z += z * limit;
    state->velocity.y -= body->gravity * SFG_TICK_SECONDS;
    state->velocity.y = state->velocity.y < -MAX_FALL_SPEED ? -MAX_FALL_SPEED : state->velocity.y;
}

static void jump(const sfg_body *body, character *it) {
    const int is_near_ground = it->state.flags & SFG_GROUNDED || (float)it->ticks_in_air <= body->coyote_ticks;
    if (!it->wants_jump || body->jump_speed <= 0.0f || (!is_near_ground && it->air_jumps_left <= 0)) {
        it->state.flags = 0;
        return;
    }
    it->state.flags = is_near_ground ? SFG_JUMPED : SFG_DOUBLE_JUMPED;
    it->air_jumps_left -= is_near_ground ? 0 : 1;
    it->state.velocity.y = body->jump_speed;
    it->ticks_in_air = 255;
    it->wants_jump = 0;
}

/* Moves the body along one axis on the ground; what is no higher than a step lifts it. Returns whether it got there. */
static int walk(const world *in, float feet[3], int axis, float way) {
    const float before = feet[axis], floor = feet[1];
    const box *wall;
    feet[axis] += way;
    while ((wall = hit(in, feet)) != NULL && wall->high[1] <= floor + in->body.step_height) {
        feet[1] = wall->high[1];
    }
    if (!wall) {
        return 1;
    }
    feet[axis] = before;
    feet[1] = floor;
    return 0;
}

static void move(const world *in, character *it) {
    sfg_state *state = &it->state;
    float feet[3], before;
    const box *stop;
    feet[0] = state->feet.x;
    feet[1] = state->feet.y;
    feet[2] = state->feet.z;
    if (!walk(in, feet, 0, state->velocity.x * SFG_TICK_SECONDS)) {
        state->velocity.x = 0.0f;
    }
    if (!walk(in, feet, 2, state->velocity.z * SFG_TICK_SECONDS)) {
        state->velocity.z = 0.0f;
    }
    before = feet[1];
    feet[1] += state->velocity.y * SFG_TICK_SECONDS;
    stop = hit(in, feet);
    if (stop && state->velocity.y > 0.0f) {
        feet[1] = before;
        state->velocity.y = 0.0f;
    } else if (stop) {
        while ((stop = hit(in, feet)) != NULL) {
            feet[1] = stop->high[1];
        }
        state->velocity.y = 0.0f;
        state->flags |= SFG_GROUNDED;
        it->air_jumps_left = (int)in->body.extra_jumps;
        it->ticks_in_air = 0;
    }
    if (!(state->flags & SFG_GROUNDED) && it->ticks_in_air < 255) {
        it->ticks_in_air++;
    }
    state->feet.x = feet[0];
    state->feet.y = feet[1];
    state->feet.z = feet[2];
    state->flags |= feet[1] < in->level->low ? SFG_FELL : 0;
}

static void tick(void *world_, const sfg_command *commands, uint32_t count) {
    world *in = (world *)world_;
    uint32_t idx;
    for (idx = 0; idx < count; idx++) {
        character *it = &in->characters[commands[idx].character];
        if (commands[idx].is_first) {
            it->wants_jump = commands[idx].action.jump > 0.0f;
        }
        steer(&in->body, it, &commands[idx].action);
        jump(&in->body, it);
        move(in, it);
    }
}

static void state(void *world_, uint32_t idx, sfg_state *state) {
    const world *in = (const world *)world_;
    const character *it = &in->characters[idx];
    const int can_jump = it->state.flags & SFG_GROUNDED || (float)it->ticks_in_air <= in->body.coyote_ticks || it->air_jumps_left > 0;
    *state = it->state;
    state->flags |= can_jump ? SFG_CAN_JUMP : 0;
}

/* Distance to a box along a ray, no more than `best`. */
static float distance_to(const box *it, const float origin[3], const float inverse[3], float best) {
    float enters = 0.0f, leaves = best;
    int axis;
    for (axis = 0; axis < 3; axis++) {
        const float one = (it->low[axis] - origin[axis]) * inverse[axis], other = (it->high[axis] - origin[axis]) * inverse[axis];
        const float first = one < other ? one : other, last = one < other ? other : one;
        enters = first > enters ? first : enters;
        leaves = last < leaves ? last : leaves;
    }
    return enters <= leaves ? enters : best;
}

static void cast(void *world_, sfg_vec3 origin, const sfg_vec3 directions[SFG_RAYS], float range, sfg_hit hits[SFG_RAYS]) {
    const boxes *level = ((const world *)world_)->level;
    const float from[3] = { origin.x, origin.y, origin.z };
    int ray, idx, axis;
    for (ray = 0; ray < SFG_RAYS; ray++) {
        const float way[3] = { directions[ray].x, directions[ray].y, directions[ray].z };
        float inverse[3], best = range;
        for (axis = 0; axis < 3; axis++) {
            inverse[axis] = 1.0f / (fabsf(way[axis]) < 1.0e-9f ? 1.0e-9f : way[axis]);
        }
        for (idx = 0; idx < level->count; idx++) {
            best = distance_to(&level->boxes[idx], from, inverse, best);
        }
        if (best < range) {
            hits[ray].distance = best;
            hits[ray].surface = SFG_GROUND;
        }
    }
}

/* Places on top of boxes where a body of 1.8 m stands free. */
static uint32_t places(void *user, uint64_t seed, sfg_vec3 *found, uint32_t most) {
    world it;
    uint32_t count = 0, tries;
    memset(&it, 0, sizeof it);
    it.level = (const boxes *)user;
    it.body.radius = 0.3f;
    it.body.height = 1.8f;
    for (tries = 0; tries < 20 * most && count < most; tries++) {
        const box *on;
        float feet[3], share[3];
        int axis;
        for (axis = 0; axis < 3; axis++) {
            seed = seed * 6364136223846793005u + 1442695040888963407u;
            share[axis] = (float)(seed >> 40) / 16777216.0f;
        }
        on = &it.level->boxes[(int)(share[1] * (float)it.level->count)];
        feet[0] = on->low[0] + share[0] * (on->high[0] - on->low[0]);
        feet[1] = on->high[1];
        feet[2] = on->low[2] + share[2] * (on->high[2] - on->low[2]);
        if (!hit(&it, feet)) {
            found[count].x = feet[0];
            found[count].y = feet[1];
            found[count].z = feet[2];
            count++;
        }
    }
    return count;
}

int main(int argc, char **argv) {
    static boxes level;
    float origin[3] = { 0.0f, 0.0f, 0.0f };
    char error[SFG_REFUSAL_BYTES] = "";
    sfg_game game;
    sfg_server *server;
    int idx;
    if (argc != 3 && argc != 6) {
        fprintf(stderr, "usage: boxes LEVEL.obj ADDRESS [X Y Z], such as: boxes boxes.obj tcp://127.0.0.1:7701 2 1 2\n");
        return 2;
    }
    for (idx = 3; idx < argc; idx++) {
        origin[idx - 3] = (float)atof(argv[idx]);
    }
    if (load(&level, argv[1], origin) != 0) {
        fprintf(stderr, "cannot read boxes from %s\n", argv[1]);
        return 1;
    }
    memset(&game, 0, sizeof game);
    game.user = &level;
    game.open = open_world;
    game.close = close_world;
    game.place = place;
    game.tick = tick;
    game.state = state;
    game.cast = cast;
    game.places = places;
    server = sfg_listen(argv[2], &game, error);
    if (!server) {
        fprintf(stderr, "cannot listen at %s: %s\n", argv[2], error);
        return 1;
    }
    printf("%d boxes at port %d\n", level.count, sfg_port(server));
    fflush(stdout);
    /* An engine would poll once a frame, with 0. */
    while (sfg_poll(server, -1) >= 0) {
    }
    fprintf(stderr, "%s\n", sfg_error(server));
    sfg_free(server);
    return 1;
}

/* Hears and asks a sonar over DDS. Its argument is the fingerprint of scan. */

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <dds/dds.h>

#include "RoboCompSonar.h"

static dds_entity_t participant, requests, replies;
static uint64_t fingerprint, client, number;

static dds_entity_t topic(const dds_topic_descriptor_t *kind, const char *name) {
    return dds_create_topic(participant, kind, name, NULL, NULL);
}

/* The next sample of a reader, to be given back by dds_return_loan; NULL if none comes within a second. */
static void *take(dds_entity_t reader) {
    void *samples[1] = {NULL};
    dds_sample_info_t info[1];
    for (int waited = 0; waited < 1000; waited++) {
        if (dds_take(reader, samples, info, 1, 1) > 0) {
            if (info[0].valid_data) return samples[0];
            dds_return_loan(reader, samples, 1);
        }
        dds_sleepfor(DDS_MSECS(1));
    }
    return NULL;
}

static RoboCompSonar_SonarScanResponse *ask(float *angles, uint32_t count) {
    for (int attempt = 0; attempt < 10; attempt++) {
        RoboCompSonar_SonarScanRequest request = {
            .header = {.version = 1, .remaining_ms = 5000, .fingerprint = fingerprint, .client = client,
                       .sequence = ++number},
            .angles = {._length = count, ._buffer = angles},
        };
        dds_write(requests, &request);
        RoboCompSonar_SonarScanResponse *reply;
        while ((reply = take(replies)) != NULL) {
            if (reply->header.client == client && reply->header.sequence == number) return reply;
        }
    }
    fprintf(stderr, "no server answers\n");
    exit(1);
}

int main(int count, char **arguments) {
    fingerprint = strtoull(count > 1 ? arguments[1] : "", NULL, 16);
    client = (uint64_t)dds_time() << 20 | (uint64_t)getpid();
    dds_qos_t *qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
    participant = dds_create_participant(0, NULL, NULL);
    requests = dds_create_writer(
        participant, topic(&RoboCompSonar_SonarScanRequest_desc, "rc/sonar/Sonar/scanRequest"), qos, NULL);
    replies = dds_create_reader(
        participant, topic(&RoboCompSonar_SonarScanResponse_desc, "rc/sonar/Sonar/scanReply"), qos, NULL);
    dds_entity_t news = dds_create_reader(
        participant, topic(&RoboCompSonar_SonarPubNearestPublication_desc, "rc/sonar/SonarPub/nearest"), qos, NULL);

    RoboCompSonar_SonarPubNearestPublication *nearest;
    while ((nearest = take(news)) == NULL) {
    }
    printf("heard %.1f m, quality %" PRId32 "\n", nearest->echo.distance, nearest->echo.quality);

    RoboCompSonar_SonarScanResponse *reply = ask((float[]){0.0f, 0.5f}, 2);
    printf("scanned %.2f %.2f\n", reply->ret._buffer[0].distance, reply->ret._buffer[1].distance);
    reply = ask((float[]){2.0f}, 1);
    printf("status %d: %s\n", reply->header.status, (char *)reply->error._buffer + 4);
    dds_delete(participant);
    return 0;
}

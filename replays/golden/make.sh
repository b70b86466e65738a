#!/bin/sh
# Makes the golden sessions anew, byte for byte, and then the reports that they must give.
# Run it in the folder of this file, with gse on the PATH; look at what changed before it is committed.
set -eu
cd "$(dirname "$0")"
rm -f ./*.mcap
gse simulate --seconds 30 --file clear.mcap
gse simulate --scenario inclined --seconds 30 --seed 2 --file inclined.mcap
gse simulate --scenario cloudy-night --rate-hz 5 --seed 3 --file cloudy.mcap
gse simulate --scenario cold-start --seconds 45 --seed 4 --file faults.mcap \
    --faults flip:1e-5,insert:1e-5,noise:1e-5,drop_frame:0.005,double_frame:0.01,swap_frame:0.01,disconnect:30s/1s
gse simulate --scenario own-answers.yaml --seed 5 --file own-answers.mcap
for name in nsp-polled ccsds-packets text-lines slip-polled; do
    gse simulate --scenario $name.yaml --seed 6 --file $name.mcap
done
gse simulate --scenario items.yaml --seed 7 --file items.mcap
gse simulate --scenario text-objects.yaml --seed 6 --file text-objects.mcap --faults drop:2e-5
gse ci . --update

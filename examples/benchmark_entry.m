% An entry to markerseek benchmark in GNU Octave: steps of 2.5 degrees, and the strongest of them.
% markerseek benchmark --entry "octave-cli --quiet examples/benchmark_entry.m"
% fgetl would wait for the line after the one that it reads.
while true
  told = jsondecode (input ('', 's'));
  if strcmp (told.type, 'search')
    angles = linspace (told.low_deg, told.high_deg, 29);
    taken = 0;
    best = [-Inf, 0];
  else
    taken++;
    if told.intensity > best(1)
      best = [told.intensity, told.angle_deg];
    end
  end
  if taken < numel (angles)
    reply = struct ('angle_deg', angles(taken + 1));
  else
    reply = struct ('answer', 'found', 'angle_deg', best(2), 'low_deg', best(2) - 2.5, 'high_deg', best(2) + 2.5);
  end
  printf ("%s\n", jsonencode (reply));
  fflush (stdout);
end

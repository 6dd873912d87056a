#include <cstdio>
#include "refsim_vectors.h"
int main(int, char **argv)
{
    const refsim::Vectors file(argv[1]);
    for (const refsim::Case &c : file.cases())
        for (const char *kept : {"linear_momentum", "angular_momentum", "dissipation"})
            if (c.has(std::string("invariant/") + kept)) {
                std::vector<double> right = c.get<double>("answer/acceleration"), wrong = right;
                for (std::size_t k = 0; k < wrong.size(); k++)
                    wrong[k] = k < wrong.size() / 2 ? 1.01 * wrong[k] : -wrong[k];
                const int holds = c.invariant(kept, right) <= 1, slips = c.invariant(kept, wrong) <= 1;
                std::printf("%s %s %d %d\n", c.name.c_str(), kept, holds, slips);
            }
}
